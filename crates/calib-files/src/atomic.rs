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
    writer::{SUFFIX, is_abandoned, is_temporary, prefix},
};

/// Writes `path` as a whole. `fill` writes to a temporary file in the same directory, which is synced and then renamed.
/// After a crash, `path` holds the old content or the new.
///
/// # Errors
/// If the directory cannot be written, `path` is a link, or `fill` fails; `path` is then untouched.
pub fn write_atomically(
    path: &Path,
    fill: impl FnOnce(&mut Output<'_>) -> io::Result<()>,
) -> Result<(), FileError> {
    write_whole(path, ExistingFile::Replaced, fill)
}

/// Writes a new file as [`write_atomically`] does. If several processes write it, one of them succeeds.
///
/// # Errors
/// As [`write_atomically`], and [`FileError::Occupied`] if `path` exists, even if it was created meanwhile.
pub fn write_new(
    path: &Path,
    fill: impl FnOnce(&mut Output<'_>) -> io::Result<()>,
) -> Result<(), FileError> {
    write_whole(path, ExistingFile::Kept, fill)
}

fn write_whole(
    path: &Path,
    existing: ExistingFile,
    fill: impl FnOnce(&mut Output<'_>) -> io::Result<()>,
) -> Result<(), FileError> {
    let directory = directory_of(path);
    create_directory(directory)?;
    put(path, directory, existing, fill).map_err(|source| match source.kind() {
        io::ErrorKind::AlreadyExists if existing == ExistingFile::Kept => {
            FileError::Occupied { path: path.to_owned() }
        }
        _ => FileError::io("write", path, source),
    })
}

/// The treatment of an existing file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExistingFile {
    /// It is kept, and nothing is written.
    Kept,
    /// It is replaced.
    Replaced,
}

/// Checks whether [`write_output`] could begin, for work that takes long before it writes. Half-written files of killed
/// processes beside `path` are removed.
///
/// # Errors
/// As [`write_output`]; `path` is untouched.
pub fn check_output(path: &Path, existing: ExistingFile) -> Result<(), FileError> {
    if Target::of(path, existing)? == Target::Device {
        return Ok(());
    }
    let directory = directory_of(path);
    create_directory(directory)?;
    // Files that cannot be removed do no harm.
    let _ = remove_temporaries(directory, Below::Unknown);
    temporary_in(directory).map(drop).map_err(|source| FileError::io("write", path, source))
}

/// Creates a file in `directory` that is renamed once it is complete.
pub(crate) fn temporary_in(directory: &Path) -> io::Result<tempfile::NamedTempFile> {
    tempfile::Builder::new()
        .prefix(&prefix())
        .suffix(SUFFIX)
        .permissions(default_permissions())
        .tempfile_in(directory)
}

fn put(
    path: &Path,
    directory: &Path,
    existing: ExistingFile,
    fill: impl FnOnce(&mut Output<'_>) -> io::Result<()>,
) -> io::Result<()> {
    if existing == ExistingFile::Replaced {
        refuse_link(path)?;
    }
    reach(Operation::Create, path)?;
    let mut temporary = temporary_in(directory)?;
    write_to(temporary.as_file_mut(), path, fill)?;
    reach(Operation::Sync, path)?;
    temporary.as_file().sync_all()?;
    reach(Operation::Rename, path)?;
    let kept = match existing {
        ExistingFile::Kept => temporary.persist_noclobber(path),
        ExistingFile::Replaced => temporary.persist(path),
    };
    match kept {
        // The file system has neither links nor renames that replace nothing.
        Err(failed) if existing == ExistingFile::Kept && fs::symlink_metadata(path).is_err() => {
            failed.file.persist(path).map_err(|failed| failed.error)?;
        }
        Err(failed) if existing == ExistingFile::Kept => {
            return Err(io::Error::new(io::ErrorKind::AlreadyExists, failed.error));
        }
        kept => drop(kept.map_err(|failed| failed.error)?),
    }
    sync_directory(directory)
}

/// Refuses a link in the place of a file. A user created it, and a rename over it would remove it.
fn refuse_link(path: &Path) -> io::Result<()> {
    if fs::symlink_metadata(path).is_ok_and(|found| found.is_symlink()) {
        let reason = "it is a link, which calib neither follows nor replaces; remove it, or name the file that it leads to";
        return Err(io::Error::new(io::ErrorKind::InvalidInput, reason));
    }
    Ok(())
}

fn write_to(
    file: &mut File,
    path: &Path,
    fill: impl FnOnce(&mut Output<'_>) -> io::Result<()>,
) -> io::Result<()> {
    let mut output = Announced::output(file, path);
    fill(&mut output).and_then(|()| output.flush())
}

/// The content of the directories below a claimed one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Below {
    /// Files of the same artefact.
    Ours,
    /// Any files: the directory is the user's.
    Unknown,
}

/// Removes the half-written files of killed processes in `directory`, and in its subdirectories if they are ours. Files
/// that another process is writing, on this machine or on another one, are kept.
///
/// # Errors
/// If it cannot be read, or a file cannot be removed.
pub fn remove_temporaries(directory: &Path, below: Below) -> Result<(), FileError> {
    let entries = fs::read_dir(directory)
        .map_err(|source| FileError::unreadable_folder(directory, source))?;
    for entry in entries {
        let entry = entry.map_err(|source| FileError::unreadable_folder(directory, source))?;
        let path = entry.path();
        let kind =
            entry.file_type().map_err(|source| FileError::unreadable_folder(directory, source))?;
        if kind.is_dir() {
            if below == Below::Ours {
                remove_temporaries(&path, below)?;
            }
        } else if is_temporary(&path)
            && is_abandoned(&path)
                .map_err(|source| FileError::unreadable_folder(directory, source))?
        {
            remove_file(&path)?;
        }
    }
    Ok(())
}

/// Puts the content of `from` at `path` as a whole: as a hard link where the file system supports it, otherwise as a
/// copy. Files are replaced and never changed, so that later changes to one name do not affect the other.
///
/// # Errors
/// If `from` cannot be read, or the directory of `path` cannot be written; `path` is then untouched.
pub fn link_or_copy(from: &Path, path: &Path) -> Result<(), FileError> {
    let directory = directory_of(path);
    create_directory(directory)?;
    if link(from, path, directory).map_err(|source| FileError::io("write", path, source))? {
        return Ok(());
    }
    let mut file = crate::open_regular(from)?;
    write_atomically(path, |copy| io::copy(&mut file, copy).map(|_| ()))
}

/// Creates a hard link. False if the file system does not support it, or `from` is on another one.
fn link(from: &Path, path: &Path, directory: &Path) -> io::Result<bool> {
    reach(Operation::Create, path)?;
    let prefix = prefix();
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).suffix(SUFFIX);
    let Ok(temporary) = builder.make_in(directory, |name| fs::hard_link(from, name)) else {
        return Ok(false);
    };
    reach(Operation::Rename, path)?;
    // Renaming to a hard link of the same file does nothing; the temporary name is removed with `temporary`.
    let temporary = temporary.into_temp_path();
    fs::rename(&temporary, path)?;
    drop(temporary);
    sync_directory(directory)?;
    Ok(true)
}

/// Writes a file that the user named. An existing file is replaced only on request, and a link never. A device or a
/// pipe is written to.
///
/// # Errors
/// As [`write_atomically`], and [`FileError::Occupied`] for a file that must be kept.
pub fn write_output(
    path: &Path,
    existing: ExistingFile,
    fill: impl FnOnce(&mut Output<'_>) -> io::Result<()>,
) -> Result<(), FileError> {
    match Target::of(path, existing)? {
        Target::File => write_whole(path, existing, fill),
        Target::Device => File::options()
            .write(true)
            .open(path)
            .and_then(|mut device| write_to(&mut device, path, fill))
            .map_err(|source| FileError::io("write", path, source)),
    }
}

/// The present state of the place for a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Target {
    /// No file, or a file that may be replaced.
    File,
    /// A device or a pipe, perhaps at the end of a link, such as `/dev/stdout`.
    Device,
}

impl Target {
    fn of(path: &Path, existing: ExistingFile) -> Result<Self, FileError> {
        match fs::metadata(path) {
            Ok(end) if end.is_dir() => {
                let source = io::Error::new(io::ErrorKind::IsADirectory, "it is a folder");
                Err(FileError::io("write", path, source))
            }
            Ok(end) if !end.is_file() => Ok(Self::Device),
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                Err(FileError::io("write", path, error))
            }
            end => {
                refuse_link(path).map_err(|source| FileError::io("write", path, source))?;
                match existing {
                    ExistingFile::Kept if end.is_ok() => {
                        Err(FileError::Occupied { path: path.to_owned() })
                    }
                    _ => Ok(Self::File),
                }
            }
        }
    }
}

/// Returns the permissions for results. Temporary files are private by default, but results should be readable like any
/// other file.
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
    use crate::writer::tests::{half_written_by_a_dead_process, half_written_by_this_process};

    #[test]
    fn half_written_files_of_killed_processes_go() {
        let place = tempfile::tempdir().expect("a directory");
        let own = half_written_by_this_process(place.path());
        let dead = half_written_by_a_dead_process(place.path());
        let whole = place.path().join("one.json");
        fs::write(&whole, b"1").expect("written");
        remove_temporaries(place.path(), Below::Unknown).expect("removed");
        assert!(own.exists() && whole.exists());
        assert!(dead.is_none_or(|dead| !dead.exists()));
        assert!(remove_temporaries(&place.path().join("missing"), Below::Unknown).is_err());
    }

    #[cfg(unix)]
    #[test]
    fn outputs_replace_no_link_and_no_file_that_is_to_stay() {
        use std::os::unix::fs::{FileTypeExt as _, symlink};
        let directory = tempfile::tempdir().expect("a directory");
        let at = |name: &str| directory.path().join(name);
        fs::write(at("own"), b"old").expect("written");
        symlink("own", at("link")).expect("linked");
        symlink("later", at("dangling")).expect("linked");
        for link in ["link", "dangling"] {
            for existing in [ExistingFile::Kept, ExistingFile::Replaced] {
                let refused = write_output(&at(link), existing, |file| file.write_all(b"new"));
                assert!(format!("{refused:?}").contains("it is a link"), "{refused:?}");
                assert!(check_output(&at(link), existing).is_err());
            }
            assert!(write_atomically(&at(link), |file| file.write_all(b"new")).is_err());
            assert!(fs::symlink_metadata(at(link)).expect("there").is_symlink());
        }
        assert!(!at("later").exists());
        let kept = write_output(&at("own"), ExistingFile::Kept, |file| file.write_all(b"new"));
        assert!(matches!(kept, Err(FileError::Occupied { .. })), "{kept:?}");
        assert_eq!(fs::read(at("own")).expect("readable"), b"old");
        write_output(&at("own"), ExistingFile::Replaced, |file| file.write_all(b"new"))
            .expect("named");
        assert_eq!(fs::read(at("own")).expect("readable"), b"new");
        symlink("/dev/null", at("null")).expect("linked");
        write_output(&at("null"), ExistingFile::Kept, |file| file.write_all(b"new"))
            .expect("written");
        let device = fs::metadata(at("null")).expect("there");
        assert!(device.file_type().is_char_device());
        assert!(write_output(directory.path(), ExistingFile::Replaced, |_| Ok(())).is_err());
    }

    #[test]
    fn a_file_that_came_meanwhile_stays() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("new");
        let written = write_new(&path, |file| {
            fs::write(&path, b"another's")?;
            file.write_all(b"ours")
        });
        assert!(matches!(written, Err(FileError::Occupied { .. })), "{written:?}");
        assert_eq!(fs::read(&path).expect("readable"), b"another's");
        assert_eq!(fs::read_dir(directory.path()).expect("readable").count(), 1);
    }

    #[test]
    fn whether_a_file_could_be_written_is_told_before() {
        let directory = tempfile::tempdir().expect("a directory");
        let at = |name: &str| directory.path().join(name);
        check_output(&at("new/file.txt"), ExistingFile::Kept).expect("writable");
        assert_eq!(fs::read_dir(at("new")).expect("made").count(), 0, "nothing is left there");
        fs::write(at("file"), b"old").expect("written");
        assert!(check_output(&at("file/below"), ExistingFile::Replaced).is_err());
        assert!(check_output(&at("file"), ExistingFile::Kept).is_err());
        check_output(&at("file"), ExistingFile::Replaced).expect("could be replaced");
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
