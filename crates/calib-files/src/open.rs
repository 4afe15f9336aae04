use std::{
    fs::{self, File},
    io,
    path::Path,
};

use crate::FileError;

/// Opens a file for reading. Pipes, sockets and devices are refused before they are opened: opening one can wait for
/// ever, and reading one has side effects. Files below `/proc` and `/sys` are refused too: the kernel generates them on
/// reading, and they may never end.
///
/// # Errors
/// If there is no such file, it cannot be read, or it is not a regular file.
pub fn open_regular(path: &Path) -> Result<File, FileError> {
    require_regular(path)?;
    File::open(path).map_err(|source| FileError::io("read", path, source))
}

/// Reads the content of a file, with the refusals of [`open_regular`].
///
/// # Errors
/// As [`open_regular`].
pub fn read_regular(path: &Path) -> Result<Vec<u8>, FileError> {
    require_regular(path)?;
    fs::read(path).map_err(|source| FileError::io("read", path, source))
}

/// Returns the size of a file in bytes, with the refusals of [`open_regular`].
///
/// # Errors
/// As [`open_regular`].
pub fn regular_bytes(path: &Path) -> Result<u64, FileError> {
    let file = open_regular(path)?;
    Ok(file.metadata().map_err(|source| FileError::io("read", path, source))?.len())
}

/// Opens a file for appending, with the refusals of [`open_regular`], and creates it if it does not exist. This is for
/// logs of work, not for results, which are complete or absent.
///
/// # Errors
/// If it is no regular file, or cannot be created or written.
pub fn open_to_append(path: &Path) -> Result<File, FileError> {
    if fs::symlink_metadata(path).is_ok() {
        require_regular(path)?;
    }
    let opened = File::options().append(true).create(true).open(path);
    opened.map_err(|source| FileError::io("write", path, source))
}

/// Checks that `path` leads to a regular file.
///
/// # Errors
/// If there is no such file, or it is a folder, a pipe, a socket or a device.
pub fn require_regular(path: &Path) -> Result<(), FileError> {
    let found = fs::metadata(path).map_err(|source| FileError::io("read", path, source))?;
    let kind = if found.is_dir() {
        "a folder"
    } else if !found.is_file() {
        "a pipe, a socket or a device"
    } else if is_of_the_kernel(path) {
        "what the kernel says of itself"
    } else {
        return Ok(());
    };
    let reason = format!("expected a file, and it is {kind}; give a copy of its content");
    Err(FileError::io("read", path, io::Error::new(io::ErrorKind::InvalidInput, reason)))
}

/// Whether two paths lead to the same existing file.
pub fn is_same_file(one: &Path, other: &Path) -> bool {
    #[cfg(unix)]
    {
        identity(one).is_some_and(|one| Some(one) == identity(other))
    }
    #[cfg(not(unix))]
    {
        fs::canonicalize(one)
            .is_ok_and(|one| fs::canonicalize(other).is_ok_and(|other| other == one))
    }
}

/// Returns the device and inode number of the file that a path leads to, if it exists.
#[cfg(unix)]
fn identity(path: &Path) -> Option<(u64, u64)> {
    use std::os::unix::fs::MetadataExt as _;
    fs::metadata(path).ok().map(|metadata| (metadata.dev(), metadata.ino()))
}

/// Whether a file is on a virtual file system, whose content the kernel generates on reading.
#[cfg(target_os = "linux")]
fn is_of_the_kernel(path: &Path) -> bool {
    // PROC_SUPER_MAGIC, SYSFS_MAGIC, DEBUGFS_MAGIC, TRACEFS_MAGIC, SECURITYFS_MAGIC, CGROUP_SUPER_MAGIC, CGROUP2_SUPER_MAGIC,
    // BPF_FS_MAGIC, PSTOREFS_MAGIC, EFIVARFS_MAGIC, from linux/magic.h.
    const KERNEL: [u64; 10] = [
        0x9fa0,
        0x6265_6572,
        0x6462_6720,
        0x7472_6163,
        0x7363_6673,
        0x0027_e0eb,
        0x6367_7270,
        0xcafe_4a11,
        0x6165_676c,
        0xde5e_81e4,
    ];
    // The type is signed on some machines.
    rustix::fs::statfs(path).is_ok_and(|stat| KERNEL.contains(&(stat.f_type as u64 & 0xffff_ffff)))
}

#[cfg(not(target_os = "linux"))]
fn is_of_the_kernel(_: &Path) -> bool {
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_appended_follows_what_is_there() {
        use std::io::Write as _;
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("log");
        for line in ["first\n", "second\n"] {
            let mut file = open_to_append(&path).expect("writable");
            file.write_all(line.as_bytes()).expect("room");
        }
        assert_eq!(fs::read_to_string(&path).expect("readable"), "first\nsecond\n");
        assert!(open_to_append(directory.path()).is_err());
        assert!(open_to_append(&directory.path().join("none/log")).is_err());
    }

    /// Returns the message with which a path is refused.
    fn refusal(path: &Path) -> String {
        format!("{:?}", open_regular(path).expect_err("refused"))
    }

    #[test]
    fn only_files_are_opened() {
        let directory = tempfile::tempdir().expect("a directory");
        let file = directory.path().join("a");
        fs::write(&file, b"content").expect("written");
        assert_eq!(read_regular(&file).expect("readable"), b"content");
        assert!(refusal(directory.path()).contains("a folder"));
        assert!(refusal(&directory.path().join("none")).contains("NotFound"));
        if cfg!(unix) {
            assert!(refusal(Path::new("/dev/null")).contains("a device"));
        }
        if cfg!(target_os = "linux") {
            for path in ["/proc/uptime", "/proc/self/status", "/proc/self/maps"] {
                assert!(refusal(Path::new(path)).contains("the kernel"), "{path}");
            }
        }
    }
}
