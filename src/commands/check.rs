//! `calib check`: verifies the files of a result folder.

use calib_pipeline::{
    CheckedResults, Damage, Logs, Outcome, Printer, StepError, UnreadableLog,
    output::{count, counted},
};

use crate::cli::CheckArgs;

/// Compares the files with their recorded fingerprints, and names the damaged files.
pub(super) fn run(args: &CheckArgs, printer: &Printer) -> Result<Outcome, StepError> {
    let logs = if args.read_data { Logs::Read } else { Logs::Leave };
    let checked = calib_pipeline::check(&args.results, logs, printer)?;
    if printer.is_json() {
        printer.json(&checked)?;
    } else {
        show(&checked, printer)?;
    }
    Ok(if checked.is_whole() { Outcome::Done } else { Outcome::Negative })
}

fn show(checked: &CheckedResults, printer: &Printer) -> Result<(), StepError> {
    for Damage { path, reason, made_by } in &checked.damages {
        printer.result(&format!("{}: {reason}; `{made_by}` makes it again", path.display()))?;
    }
    for folder in &checked.unfinished {
        printer.result(&format!("{} is not finished", folder.display()))?;
    }
    for UnreadableLog { path, reason } in &checked.unreadable_logs {
        printer.result(&format!("the log in {path} cannot be read: {reason}"))?;
    }
    for log in &checked.logs {
        printer.result(&format!("the log in {log} can be read"))?;
    }
    let damaged = checked.damages.len();
    printer.result(&format!(
        "{} of {} in {} are as they were written; damaged or missing: {}",
        count(checked.files.saturating_sub(damaged)),
        counted(checked.files, "file"),
        checked.root.display(),
        count(damaged)
    ))
}
