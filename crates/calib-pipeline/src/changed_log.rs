//! Detects that the log of a study has changed since its results were made.

use std::path::PathBuf;

use calib_base::log::{plant_of_study::data_of, prepared};
use calib_study::{Job, Scope};

/// Returns a file of the log whose name, size or date changed since the log was read, for any deployment of the study.
/// `None` if no file changed, or if this is not known, for example because the log is gone.
pub(crate) fn changed_file(job: &Job) -> Option<PathBuf> {
    let parts = job.parts(Scope::Deployment).ok()?;
    parts.iter().find_map(|part| {
        let data = data_of(part).ok()?;
        prepared::changed_file(part, &data).ok()?
    })
}

/// Returns the warning about a verdict on a changed log, if it has changed.
pub(crate) fn old_verdict(job: &Job) -> Option<String> {
    let file = changed_file(job)?;
    Some(format!(
        "the log has changed: {} has another name, size or date than when the log was read. The verdict is on the log as it was; `{}` \
         judges it as it is",
        file.display(),
        job.run_command()
    ))
}

/// Returns the reason for reading the log again, if it has changed.
pub(crate) fn why_read_again(job: &Job) -> Option<String> {
    let file = changed_file(job)?;
    Some(format!(
        "{} has another name, size or date than when the log was read: `{}` reads the log again, and keeps results whose content is \
         the same",
        file.display(),
        job.run_command()
    ))
}
