//! Whether the log of a study is another than the one that its results were made from.

use std::path::PathBuf;

use calib_base::log::{plant_of_study::data_of, prepared};
use calib_study::{Job, Scope};

/// A file of the log that has another name, size or date than when the log was read for any deployment of the study. None if there is
/// none, or that is not known, as of a log that is gone.
pub(crate) fn changed_file(job: &Job) -> Option<PathBuf> {
    let parts = job.parts(Scope::Deployment).ok()?;
    parts.iter().find_map(|part| {
        let data = data_of(part).ok()?;
        prepared::changed_file(part, &data).ok()?
    })
}

/// What is said of a verdict on a log that has changed, if it has.
pub(crate) fn old_verdict(job: &Job) -> Option<String> {
    let file = changed_file(job)?;
    Some(format!(
        "the log has changed: {} has another name, size or date than when the log was read. The verdict is on the log as it was; `{}` \
         judges it as it is",
        file.display(),
        job.run_command()
    ))
}

/// Why the log is to be read, where it was read before.
pub(crate) fn why_read_again(job: &Job) -> Option<String> {
    let file = changed_file(job)?;
    Some(format!(
        "{} has another name, size or date than when the log was read: `{}` reads the log again, and keeps results whose content is \
         the same",
        file.display(),
        job.run_command()
    ))
}
