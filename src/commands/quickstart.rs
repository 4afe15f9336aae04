use std::path::Path;

use calib_files::{FileError, read_regular, write_new};
use calib_pipeline::{Context as _, Job, Outcome, Printer, Request, StepError, bail};

use crate::cli::QuickstartArgs;

/// Study that quickstart runs; `configs/quickstart.toml` in the repository.
const STUDY: &str = include_str!("../../configs/quickstart.toml");

/// Simulates a plant, runs all steps on it, and keeps all files in a directory.
pub(super) fn run(args: &QuickstartArgs, printer: &Printer) -> Result<Outcome, StepError> {
    let directory = &args.directory;
    printer.heading(
        "calib quickstart: four and a half days of a simulated plant, from its logs to a verdict",
    );
    let study = write_study(directory, args.seed)?;
    let ended = calib_pipeline::run(&Job::resolve(Request::new(&study))?, None, printer)?;
    printer.say(&format!(
        "Open the report in a browser; then copy {}, point its data.path at your own logs, and remove [simulate].",
        study.display(),
    ));
    Ok(ended.outcome())
}

/// Writes the study file beside the data, as a start for the user's own.
fn write_study(directory: &Path, seed: u64) -> Result<std::path::PathBuf, StepError> {
    let path = directory.join("study.toml");
    // The first line names the schema, which only the original file has beside it.
    let (_schema, text) = STUDY.split_once('\n').context("the study has lines")?;
    let text = text.replace("seed = 0", &format!("seed = {seed}"));
    if read_regular(&path).is_ok_and(|found| found == text.as_bytes()) {
        return Ok(path);
    }
    match write_new(&path, |file| std::io::Write::write_all(file, text.as_bytes())) {
        Err(FileError::Occupied { .. }) => bail!(
            "{} exists and is another study; run the steps on it one by one, or choose another directory",
            path.display()
        ),
        written => written?,
    }
    Ok(path)
}
