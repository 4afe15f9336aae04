use std::{
    fs::{self, File, OpenOptions, TryLockError},
    io,
    path::Path,
};

use crate::{
    FileError,
    faults::{self, Operation, reach},
};

/// The lock of this process on a folder.
#[derive(Debug)]
pub enum Lock {
    /// This process holds it until the file is closed.
    Held(File),
    /// Another process holds it.
    Taken,
    /// The file system has no locks. No result may depend on a lock: locks keep two commands from doing the same work
    /// twice, and both would write the same.
    Unknown,
}

/// Locks the file `path`, and creates it if it does not exist.
///
/// # Errors
/// If the folder does not exist or cannot be written, or there is a link or a folder in the place of the file.
pub fn lock(path: &Path) -> Result<Lock, FileError> {
    let file = open_lock(path)?;
    if faults::have_no_locks() {
        return Ok(Lock::Unknown);
    }
    Ok(match file.try_lock() {
        Ok(()) => Lock::Held(file),
        Err(TryLockError::WouldBlock) => Lock::Taken,
        Err(TryLockError::Error(_)) => Lock::Unknown,
    })
}

/// Opens or creates a lock file, for reading and appending. Its content is kept. A link is not followed, because its
/// target does not belong to calib.
///
/// # Errors
/// If it cannot be created, or something other than a file has its name.
pub(crate) fn open_lock(path: &Path) -> Result<File, FileError> {
    let mut options = OpenOptions::new();
    options.read(true).append(true).create(true);
    #[cfg(unix)]
    {
        use std::os::unix::fs::OpenOptionsExt as _;
        let flags = rustix::fs::OFlags::NOFOLLOW | rustix::fs::OFlags::NONBLOCK;
        options.custom_flags(flags.bits().cast_signed());
    }
    if fs::symlink_metadata(path).is_ok_and(|found| !found.is_file()) {
        let reason = "it is a link, a folder or a device, and calib keeps a file there; remove it";
        let source = io::Error::new(io::ErrorKind::InvalidInput, reason);
        return Err(FileError::io("lock", path, source));
    }
    if !path.exists() {
        reach(Operation::Create, path).map_err(|source| FileError::io("lock", path, source))?;
    }
    options.open(path).map_err(|source| FileError::io("lock", path, source))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_emptied() {
        let directory = tempfile::tempdir().expect("a directory");
        let lock = directory.path().join(".lock");
        open_lock(&lock).expect("made");
        fs::write(&lock, b"a user's own").expect("written");
        open_lock(&lock).expect("opened");
        assert_eq!(fs::read(&lock).expect("readable"), b"a user's own");
    }

    #[cfg(unix)]
    #[test]
    fn links_are_not_followed() {
        let directory = tempfile::tempdir().expect("a directory");
        let lock = directory.path().join(".lock");
        let own = directory.path().join("thesis.tex");
        fs::write(&own, b"a user's own").expect("written");
        std::os::unix::fs::symlink(&own, &lock).expect("linked");
        let error = format!("{:?}", open_lock(&lock).expect_err("refused"));
        assert!(error.contains("it is a link"), "{error}");
        assert_eq!(fs::read(&own).expect("readable"), b"a user's own");
    }
}
