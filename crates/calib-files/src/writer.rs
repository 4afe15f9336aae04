//! The writer of a temporary file, which its name identifies, because locks are not reliable. Some file systems of
//! clusters have no locks, and on some they hold on one node only.

use std::{
    fs, io,
    path::Path,
    process,
    sync::OnceLock,
    time::{Duration, SystemTime},
};

use crate::{
    Fingerprint,
    faults::{Operation, reach},
};

const PREFIX: &str = ".calib-";
/// Suffix of the names of temporary files.
pub(crate) const SUFFIX: &str = ".tmp";

/// Age after which an unchanged file of another machine counts as abandoned.
const ABANDONED_AFTER: Duration = Duration::from_hours(24);

/// Returns the name of this machine; empty where the system does not report it.
pub fn host_name() -> &'static str {
    static NAME: OnceLock<String> = OnceLock::new();
    NAME.get_or_init(|| {
        let name = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
        name.trim().to_owned()
    })
}

/// Returns digits that identify the processes that this one can see: those of this machine, or of its container.
fn machine() -> Option<&'static str> {
    static MACHINE: OnceLock<Option<String>> = OnceLock::new();
    MACHINE
        .get_or_init(|| {
            let processes = fs::read_link("/proc/self/ns/pid").ok()?;
            let text = format!("{} {}", host_name(), processes.display());
            Some(Fingerprint::of(text.as_bytes()).short().to_owned())
        })
        .as_deref()
}

/// Returns the prefix of the names of this process's temporary files.
pub(crate) fn prefix() -> String {
    format!("{PREFIX}{}-{}-", machine().unwrap_or("unknown"), process::id())
}

/// Whether `path` has the name of a temporary file of [`write_atomically`](crate::write_atomically). If no process
/// writes it any more, it is left over from a killed process and may be removed.
pub fn is_temporary(path: &Path) -> bool {
    middle(path).is_some()
}

fn middle(path: &Path) -> Option<&str> {
    path.file_name()?.to_str()?.strip_prefix(PREFIX)?.strip_suffix(SUFFIX)
}

/// Whether no process writes a temporary file any more: its process has ended. If only another machine could know that,
/// the file must be a day older than a file that is written beside it now.
pub(crate) fn is_abandoned(path: &Path) -> io::Result<bool> {
    let mut parts = middle(path).unwrap_or_default().split('-');
    let writer = parts.next();
    let process = parts.next().and_then(|text| text.parse::<u32>().ok());
    match (writer, process) {
        (Some(writer), Some(process)) if Some(writer) == machine() => {
            Ok(!Path::new("/proc").join(process.to_string()).exists())
        }
        _ => is_older(path),
    }
}

/// Whether the file is older than [`ABANDONED_AFTER`], by the clock of its own disk.
fn is_older(path: &Path) -> io::Result<bool> {
    let Some(folder) = path.parent() else { return Ok(false) };
    reach(Operation::Create, folder)?;
    let now = tempfile::tempfile_in(folder)?.metadata()?.modified()?;
    let written = match fs::symlink_metadata(path) {
        Ok(found) => found.modified()?,
        // It was renamed meanwhile.
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(false),
        Err(error) => return Err(error),
    };
    Ok(age(written, now) > ABANDONED_AFTER)
}

fn age(written: SystemTime, now: SystemTime) -> Duration {
    now.duration_since(written).unwrap_or_default()
}

#[cfg(test)]
pub(crate) mod tests {
    use std::path::PathBuf;

    use super::*;

    /// Writes a file, and returns its path.
    fn half_written(folder: &Path, name: &str) -> PathBuf {
        let path = folder.join(name);
        fs::write(&path, b"half").expect("written");
        path
    }

    pub(crate) fn half_written_by_this_process(folder: &Path) -> PathBuf {
        half_written(folder, &format!("{}x{SUFFIX}", prefix()))
    }

    /// None if the system does not tell which processes live.
    pub(crate) fn half_written_by_a_dead_process(folder: &Path) -> Option<PathBuf> {
        // No process has the largest possible number.
        let name = format!("{PREFIX}{}-{}-x{SUFFIX}", machine()?, u32::MAX);
        Some(half_written(folder, &name))
    }

    #[test]
    fn files_of_others_are_theirs_until_they_are_old() {
        let directory = tempfile::tempdir().expect("a directory");
        let own = half_written_by_this_process(directory.path());
        assert!(is_temporary(&own));
        assert!(
            machine().is_none() || !is_abandoned(&own).expect("readable"),
            "this process lives"
        );
        if let Some(dead) = half_written_by_a_dead_process(directory.path()) {
            assert!(is_abandoned(&dead).expect("readable"));
        }
        for name in ["0123456789ab-7-x", "AbCdEf"] {
            let other = half_written(directory.path(), &format!("{PREFIX}{name}{SUFFIX}"));
            assert!(is_temporary(&other) && !is_abandoned(&other).expect("readable"), "{name}");
            let file = fs::File::options().write(true).open(&other).expect("writable");
            let written = file.metadata().and_then(|found| found.modified()).expect("known");
            file.set_modified(written - 2 * ABANDONED_AFTER).expect("set");
            assert!(is_abandoned(&other).expect("readable"), "{name}");
        }
    }
}
