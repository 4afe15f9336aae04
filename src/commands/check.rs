//! `calib check`: verifies the files of a result folder.

use std::path::Path;

use calib_pipeline::{
    CheckedResults, Damage, Job, Logs, Outcome, Printer, Request, StepError, ensure,
    output::{count, counted},
};

use crate::cli::CheckArgs;

/// Compares the files with their recorded fingerprints, and names the damaged files.
pub(super) fn run(args: &CheckArgs, printer: &Printer) -> Result<Outcome, StepError> {
    let logs = if args.read_data { Logs::Read } else { Logs::Leave };
    let given = &args.results;
    let root = if given.is_file() {
        let root = Job::resolve(Request::new(given))?.layout().root().to_owned();
        ensure!(
            root.is_dir(),
            "{} has no results in {}; run it first, or give the folder of its results if it was run with --output",
            given.display(),
            root.display()
        );
        root
    } else {
        ensure!(
            given.exists(),
            "{} does not exist; give a study file, or the folder of its results",
            given.display()
        );
        given.clone()
    };
    let checked = calib_pipeline::check(&root, logs, printer)?;
    if printer.is_json() {
        printer.json(&checked)?;
    } else {
        show(&checked, &root, printer)?;
    }
    Ok(if checked.damages.is_empty() { Outcome::Done } else { Outcome::Negative })
}

fn show(checked: &CheckedResults, root: &Path, printer: &Printer) -> Result<(), StepError> {
    for Damage { path, reason, made_by } in &checked.damages {
        printer.result(&format!("{}: {reason}; `{made_by}` makes it again", path.display()))?;
    }
    for folder in &checked.unfinished {
        printer.result(&format!("{} is not finished", folder.display()))?;
    }
    for log in &checked.logs {
        printer.result(&format!("the log in {log} can be read"))?;
    }
    let damaged = checked.damages.len();
    printer.result(&format!(
        "{} of {} in {} are as they were written; damaged or missing: {}",
        count(checked.files.saturating_sub(damaged)),
        counted(checked.files, "file"),
        root.display(),
        count(damaged)
    ))
}
