use std::{
    fs::{self, File},
    io::{self, Write as _},
    path::Path,
};

use crate::{
    FileError, Output, create_directory,
    disk::{Announced, directory_of, sync_directory},
    faults::{Operation, reach},
    remove_file,
    writer::{is_abandoned, is_temporary, prefix, suffix},
};

/// Write `path` as a whole: `fill` writes to a temporary file in the same directory,
/// which is synced and then renamed. After a crash `path` holds the old content or the new.
///
/// # Errors
/// If the directory cannot be written, or `fill` fails; `path` is then untouched.
pub fn write_atomically(
    path: &Path,
    fill: impl FnOnce(&mut Output<'_>) -> io::Result<()>,
) -> Result<(), FileError> {
    let directory = directory_of(path);
    create_directory(directory)?;
    replace(path, directory, fill).map_err(|source| FileError::io("write", path, source))
}

/// Whether [`write_atomically`] could begin: for what takes long before it writes.
///
/// # Errors
/// If the directory cannot be made or written; `path` is untouched.
pub fn check_writable(path: &Path) -> Result<(), FileError> {
    if path.is_dir() {
        let source = io::Error::from(io::ErrorKind::IsADirectory);
        return Err(FileError::io("write", path, source));
    }
    let directory = directory_of(path);
    create_directory(directory)?;
    temporary_in(directory).map(drop).map_err(|source| FileError::io("write", path, source))
}

fn temporary_in(directory: &Path) -> io::Result<tempfile::NamedTempFile> {
    tempfile::Builder::new()
        .prefix(&prefix())
        .suffix(suffix())
        .permissions(default_permissions())
        .tempfile_in(directory)
}

fn replace(
    path: &Path,
    directory: &Path,
    fill: impl FnOnce(&mut Output<'_>) -> io::Result<()>,
) -> io::Result<()> {
    reach(Operation::Create, path)?;
    let mut temporary = temporary_in(directory)?;
    write_to(temporary.as_file_mut(), path, fill)?;
    reach(Operation::Sync, path)?;
    temporary.as_file().sync_all()?;
    reach(Operation::Rename, path)?;
    temporary.persist(path).map_err(|failed| failed.error)?;
    sync_directory(directory)
}

fn write_to(
    file: &mut File,
    path: &Path,
    fill: impl FnOnce(&mut Output<'_>) -> io::Result<()>,
) -> io::Result<()> {
    let mut output = Announced::output(file, path);
    fill(&mut output).and_then(|()| output.flush())
}

/// What lies in the directories below a claimed one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Below {
    /// Files of the same artefact.
    Ours,
    /// Anything: the directory is the user's.
    Unknown,
}

/// Remove what a killed process left half-written in `directory`, and in those below if they are ours. What another
/// process is writing, on this machine or on another one, stays.
///
/// # Errors
/// If it cannot be read, or something cannot be removed.
pub fn remove_temporaries(directory: &Path, below: Below) -> Result<(), FileError> {
    let refused = |source| FileError::io("read the folder", directory, source);
    for entry in fs::read_dir(directory).map_err(refused)? {
        let entry = entry.map_err(refused)?;
        let path = entry.path();
        if entry.file_type().map_err(refused)?.is_dir() {
            if below == Below::Ours {
                remove_temporaries(&path, below)?;
            }
        } else if is_temporary(&path) && is_abandoned(&path).map_err(refused)? {
            remove_file(&path)?;
        }
    }
    Ok(())
}

/// Put the content of `from` at `path` as a whole: under a second name of the same file where the file system has such,
/// or else as a copy. Files are replaced and never changed, so that neither name sees what becomes of the other.
///
/// # Errors
/// If `from` cannot be read, or the directory of `path` cannot be written; `path` is then untouched.
pub fn link_or_copy(from: &Path, path: &Path) -> Result<(), FileError> {
    let directory = directory_of(path);
    create_directory(directory)?;
    let refused = |source| FileError::io("write", path, source);
    match link(from, path, directory).map_err(refused)? {
        Linked::Yes => Ok(()),
        Linked::NotHere => {
            let mut file = crate::open_regular(from)?;
            write_atomically(path, |copy| io::copy(&mut file, copy).map(|_| ()))
        }
    }
}

/// Whether a file has a second name.
enum Linked {
    Yes,
    /// The file system has no such, or `from` lies on another one.
    NotHere,
}

fn link(from: &Path, path: &Path, directory: &Path) -> io::Result<Linked> {
    reach(Operation::Create, path)?;
    let prefix = prefix();
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).suffix(suffix());
    let Ok(temporary) = builder.make_in(directory, |name| fs::hard_link(from, name)) else {
        return Ok(Linked::NotHere);
    };
    reach(Operation::Rename, path)?;
    // A name of the same file stays as it is, and the temporary one goes with `temporary`.
    let temporary = temporary.into_temp_path();
    fs::rename(&temporary, path)?;
    drop(temporary);
    sync_directory(directory)?;
    Ok(Linked::Yes)
}

/// Write a file that the user named: as [`write_atomically`], but what a link leads to is replaced rather than the
/// link, and a device or a pipe is written to.
///
/// # Errors
/// As [`write_atomically`].
pub fn write_output(
    path: &Path,
    fill: impl FnOnce(&mut Output<'_>) -> io::Result<()>,
) -> Result<(), FileError> {
    let refused = |source| FileError::io("write", path, source);
    match fs::metadata(path) {
        Ok(found) if found.is_file() => {
            write_atomically(&fs::canonicalize(path).map_err(refused)?, fill)
        }
        Ok(found) if found.is_dir() => {
            Err(refused(io::Error::new(io::ErrorKind::IsADirectory, "it is a folder")))
        }
        Ok(_) => {
            let mut device = File::options().write(true).open(path).map_err(refused)?;
            write_to(&mut device, path, fill).map_err(refused)
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => match fs::read_link(path) {
            // The link leads to where nothing is yet.
            Ok(end) => {
                let beside = path.parent().unwrap_or(Path::new(""));
                write_atomically(&beside.join(end), fill)
            }
            Err(_) => write_atomically(path, fill),
        },
        Err(error) => Err(refused(error)),
    }
}

/// Temporary files are private by default; results should be readable like any other file.
#[cfg(unix)]
fn default_permissions() -> fs::Permissions {
    use std::os::unix::fs::PermissionsExt as _;
    fs::Permissions::from_mode(0o666)
}

#[cfg(not(unix))]
fn default_permissions() -> fs::Permissions {
    fs::metadata(".")
        .map_or_else(|_| unreachable!("the working directory exists"), |m| m.permissions())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn what_a_link_leads_to_is_replaced_and_devices_are_written_to() {
        use std::os::unix::fs::{FileTypeExt as _, symlink};
        let directory = tempfile::tempdir().expect("a directory");
        let at = |name: &str| directory.path().join(name);
        fs::write(at("own"), b"old").expect("written");
        symlink("own", at("link")).expect("linked");
        symlink("later", at("dangling")).expect("linked");
        for (link, end) in [("link", "own"), ("dangling", "later")] {
            write_output(&at(link), |file| file.write_all(b"new")).expect("written");
            assert_eq!(fs::read(at(end)).expect("readable"), b"new");
            assert!(fs::symlink_metadata(at(link)).expect("there").is_symlink());
        }
        symlink("/dev/null", at("null")).expect("linked");
        write_output(&at("null"), |file| file.write_all(b"new")).expect("written");
        let device = fs::metadata(at("null")).expect("there");
        assert!(device.file_type().is_char_device());
        assert!(write_output(directory.path(), |_| Ok(())).is_err());
    }

    #[test]
    fn whether_a_file_could_be_written_is_told_before() {
        let directory = tempfile::tempdir().expect("a directory");
        let at = |name: &str| directory.path().join(name);
        check_writable(&at("new/file.txt")).expect("writable");
        assert_eq!(fs::read_dir(at("new")).expect("made").count(), 0, "nothing is left there");
        fs::write(at("file"), b"old").expect("written");
        assert!(check_writable(&at("file/below")).is_err());
        check_writable(&at("file")).expect("could be replaced");
        assert_eq!(fs::read(at("file")).expect("readable"), b"old");
    }

    #[test]
    fn a_failed_write_leaves_the_old_content() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("new/file.txt");
        write_atomically(&path, |file| file.write_all(b"old")).expect("written");
        let failed = write_atomically(&path, |file| {
            file.write_all(b"half of the n")?;
            let mut entries = fs::read_dir(path.parent().expect("has one")).expect("readable");
            assert!(entries.any(|entry| is_temporary(&entry.expect("an entry").path())));
            assert!(!is_temporary(&path));
            Err(io::Error::other("interrupted"))
        });
        assert!(failed.is_err());
        assert_eq!(fs::read(&path).expect("readable"), b"old");
        let left = fs::read_dir(path.parent().expect("has one")).expect("readable").count();
        assert_eq!(left, 1, "no temporary file is left behind");
    }
}
