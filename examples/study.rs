//! A study from Rust, without the command line: a small simulated plant, from its log to the verdict.
//!
//! ```sh
//! cargo run --release --example study -- FOLDER
//! ```

use std::{error::Error, io, path::PathBuf, sync::Arc};

use calib_core::{Monitor, Silent};
use calib_pipeline::{Job, Observer, Outcome, Printer, Remark, Request, Shown, output::ResultPart};

/// Three days of a plant, with linear agents; it runs in seconds.
const STUDY: &str = r#"
[simulate]
days = 3
channels = 8
period_secs = 60

[data]
path = "plant"
train_fraction = 0.7

[agent]
value_function = "linear"
gamma = 0.9
batch_size = 16

[rollout]
steps = 200

[sweep]
sensors = ["PIT300"]
steps = 600
online_runs = 2
member_runs = 1
log_replay_runs = 2

[sweep.grid]
learning_rate = [1e-4, 1e-3, 1e-2]
"#;

/// An observer that prints only results and warnings, on stdout.
struct Brief;

impl Observer for Brief {
    #[expect(clippy::print_stdout, reason = "an example shows what it is told")]
    fn remark(&self, remark: Remark<'_>) {
        if let Remark::Warning(text) | Remark::Error(text) = remark {
            println!("  ({text})");
        }
    }

    #[expect(clippy::print_stdout, reason = "an example shows what it is told")]
    fn result(&self, result: ResultPart<'_>) -> io::Result<()> {
        let (ResultPart::Line(text) | ResultPart::Lines(text) | ResultPart::Json(text)) = result;
        println!("{text}");
        Ok(())
    }

    fn progress(&self, _shown: Shown) -> Box<dyn Monitor> {
        Box::new(Silent)
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder: PathBuf = std::env::args_os().nth(1).ok_or("give a folder to write to")?.into();
    std::fs::create_dir_all(&folder)?;
    let file = folder.join("study.toml");
    std::fs::write(&file, STUDY)?;
    // The file is read once. A later edit changes the next run, not this one.
    let job = Job::resolve(Request::new(&file))?;
    let printer = Printer::new(Arc::new(Brief));
    match calib_pipeline::run(&job, None, &printer)?.outcome() {
        Outcome::Done => {}
        other => return Err(format!("{other:?}").into()),
    }
    // All results exist, so a step by itself does nothing.
    calib_pipeline::sweep(&job, None, &printer)?;
    Ok(())
}
