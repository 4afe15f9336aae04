//! `profile.json`: a profile of the data of a result, stored beside it, so that a report need not read a
//! log.

use std::path::Path;

use calib_data::Profile;
use calib_files::{Fingerprint, fingerprint_file, read_json, write_json};

use crate::{Context as _, StepError};

/// Name of the file.
pub const PROFILE: &str = "profile.json";

/// Writes the profile into the directory of a result.
///
/// # Errors
/// If it cannot be written.
pub fn write(directory: &Path, profile: &Profile) -> Result<(), StepError> {
    Ok(write_json(&directory.join(PROFILE), profile)?)
}

/// Reads the profile from the directory of a result, which the command `again` makes again.
///
/// # Errors
/// If it cannot be read, or is no profile.
pub fn read(directory: &Path, again: &str) -> Result<Profile, StepError> {
    let path = directory.join(PROFILE);
    read_json(&path).with_context(|| {
        format!("{} cannot be used; `{again} --force` makes it again", path.display())
    })
}

/// Whether the file is as it was `written`.
pub fn is_whole(directory: &Path, written: Option<&Fingerprint>) -> bool {
    written.is_some_and(|written| {
        fingerprint_file(&directory.join(PROFILE)).is_ok_and(|found| found == *written)
    })
}
