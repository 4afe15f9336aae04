//! Writes a sample of everything this package can show, from made-up numbers:
//!
//! ```sh
//! cargo run --release -p calib-report --example sample_report -- sample-report
//! ```
#![expect(clippy::print_stdout, reason = "an example tells where it wrote")]

mod sample;

use std::path::PathBuf;
use std::{env, error, fs};

use calib_report::Sensitivity;

fn main() -> Result<(), Box<dyn error::Error>> {
    let folder = PathBuf::from(env::args().nth(1).unwrap_or_else(|| "sample-report".to_owned()));
    fs::create_dir_all(&folder)?;
    for figure in sample::sensitivities() {
        let name = format!("sensitivity-{}", figure.sensor);
        let figure = figure.figure()?;
        fs::write(folder.join(format!("{name}.svg")), figure.svg())?;
        fs::write(folder.join(format!("{name}.png")), figure.png()?)?;
    }
    for figure in sample::rollouts() {
        let name = format!("rollout-{}", figure.sensor);
        let figure = figure.figure()?;
        fs::write(folder.join(format!("{name}.svg")), figure.svg())?;
        fs::write(folder.join(format!("{name}.png")), figure.png()?)?;
    }
    for grid in sample::grids() {
        let name = format!("rollouts-{}", grid.sensor);
        let figure = grid.figure()?;
        fs::write(folder.join(format!("{name}.svg")), figure.svg())?;
        fs::write(folder.join(format!("{name}.png")), figure.png()?)?;
    }
    for recorded in sample::recorded() {
        let name = format!("recorded-{}", recorded.sensor);
        let figure = recorded.figure()?;
        fs::write(folder.join(format!("{name}.svg")), figure.svg())?;
        fs::write(folder.join(format!("{name}.png")), figure.png()?)?;
    }
    let panels = Sensitivity::panels(&sample::sensitivities())?;
    fs::write(folder.join("sensitivity.svg"), panels.svg())?;
    fs::write(folder.join("sensitivity.png"), panels.png()?)?;
    for curves in sample::learning() {
        let name = format!("learning-{}-{}", curves.sensor, curves.environment.file_name());
        let figure = curves.figure()?;
        fs::write(folder.join(format!("{name}.svg")), figure.svg())?;
        fs::write(folder.join(format!("{name}.png")), figure.png()?)?;
    }
    let page = folder.join("report.html");
    fs::write(&page, sample::report().html()?)?;
    let mut logs_only = sample::report();
    sample::without_online(&mut logs_only);
    fs::write(folder.join("report-without-online.html"), logs_only.html()?)?;
    println!("wrote {} and figures beside it", page.display());
    Ok(())
}
