//! Writes the page and the figures of the test fixture, for a look at them:
//!
//! ```sh
//! cargo run --release -p calib-report --example sample_report -- sample-report
//! ```
#![expect(clippy::print_stdout, reason = "an example tells where it wrote")]
#![expect(clippy::unwrap_used, reason = "the report of the tests has no errors")]

#[path = "../tests/it/fixture.rs"]
mod fixture;

use std::path::PathBuf;
use std::{env, error, fs};

use calib_report::Sensitivity;

fn main() -> Result<(), Box<dyn error::Error>> {
    let folder = PathBuf::from(env::args().nth(1).unwrap_or_else(|| "sample-report".to_owned()));
    fs::create_dir_all(&folder)?;
    let report = fixture::report();
    let figures = [
        ("sensitivities", Sensitivity::panels(&report.sensitivities)?),
        ("sensitivity", report.sensitivities[0].figure()?),
        ("learning", report.learning[0].figure()?),
        ("recorded", report.recorded[0].figure()?),
        ("rollout", fixture::long_rollout().figure()?),
        ("rollouts", report.rollout_grids[0].figure()?),
    ];
    for (name, figure) in figures {
        fs::write(folder.join(format!("{name}.svg")), figure.svg())?;
        fs::write(folder.join(format!("{name}.png")), figure.png()?)?;
    }
    let page = folder.join("report.html");
    fs::write(&page, report.html()?)?;
    println!("wrote {} and figures beside it", page.display());
    Ok(())
}
