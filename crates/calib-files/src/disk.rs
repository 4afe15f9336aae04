//! The one place where calib changes a disk. Each function announces what it does, so that a test can make it fail.

use std::{
    fs::{self, File},
    io::{self, BufWriter, Write},
    path::Path,
};

use crate::{
    FileError,
    faults::{Operation, reach, reach_or_half},
};

/// What content is written to.
pub type Output<'a> = BufWriter<Announced<'a>>;

/// A file, every write to which is announced.
#[derive(Debug)]
pub struct Announced<'a> {
    file: &'a mut File,
    path: &'a Path,
}

impl<'a> Announced<'a> {
    /// A buffer before `file`, which is written for `path`.
    pub(crate) fn output(file: &'a mut File, path: &'a Path) -> Output<'a> {
        BufWriter::with_capacity(1 << 20, Self { file, path })
    }
}

impl Write for Announced<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let half = || drop(self.file.write_all(&bytes[..bytes.len() / 2]));
        reach_or_half(Operation::Write, self.path, half)?;
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Create `path` and its parents, if they do not exist. Their names are on the disk when this returns.
///
/// # Errors
/// If the system refuses.
pub fn create_directory(path: &Path) -> Result<(), FileError> {
    let missing = path.ancestors().take_while(|folder| !names_nothing(folder) && !folder.is_dir());
    let missing: Vec<&Path> = missing.collect();
    for folder in missing.into_iter().rev() {
        make_folder(folder)
            .map_err(|source| FileError::io("create the directory", folder, source))?;
    }
    Ok(())
}

/// The working directory, as `parent` of a bare name gives it.
fn names_nothing(path: &Path) -> bool {
    path.as_os_str().is_empty()
}

fn make_folder(folder: &Path) -> io::Result<()> {
    reach(Operation::MakeFolder, folder)?;
    match fs::create_dir(folder) {
        // Another process was faster.
        Err(_) if folder.is_dir() => return Ok(()),
        other => other?,
    }
    sync_directory(directory_of(folder))
}

/// The folder that holds `path`.
pub(crate) fn directory_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !names_nothing(parent) => parent,
        _ => Path::new("."),
    }
}

/// Without this a renamed file may be gone after a power failure: its name is the directory's content.
pub(crate) fn sync_directory(directory: &Path) -> io::Result<()> {
    use io::ErrorKind::{InvalidInput, PermissionDenied, Unsupported};
    reach(Operation::Sync, directory)?;
    match File::open(directory).and_then(|opened| opened.sync_all()) {
        // Not every file system syncs directories, and a directory may be writable without being readable.
        Err(error) if !matches!(error.kind(), InvalidInput | PermissionDenied | Unsupported) => {
            Err(error)
        }
        _ => Ok(()),
    }
}

/// Remove a file. That there is none is no error.
///
/// # Errors
/// If there is one, and it cannot be removed.
pub fn remove_file(path: &Path) -> Result<(), FileError> {
    let removed = reach(Operation::Remove, path).and_then(|()| fs::remove_file(path));
    absent(removed).map_err(|source| FileError::io("remove", path, source))
}

/// Remove a folder with all that is in it; links in it are removed and not followed. That there is none is no error.
///
/// # Errors
/// If there is one, and it cannot be removed.
pub fn remove_folder(path: &Path) -> Result<(), FileError> {
    let half = || {
        let entries = fs::read_dir(path).into_iter().flatten().flatten();
        entries.step_by(2).for_each(|entry| drop(fs::remove_file(entry.path())));
    };
    let removed =
        reach_or_half(Operation::Remove, path, half).and_then(|()| fs::remove_dir_all(path));
    absent(removed).map_err(|source| FileError::io("remove", path, source))
}

/// Remove a folder if it is empty; where it is not, or cannot be removed, it stays.
pub fn remove_empty_folder(path: &Path) {
    let _ = reach(Operation::Remove, path).and_then(|()| fs::remove_dir(path));
}

fn absent(removed: io::Result<()>) -> io::Result<()> {
    match removed {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_there_need_not_be_removed() {
        let directory = tempfile::tempdir().expect("a directory");
        let at = |name: &str| directory.path().join(name);
        create_directory(&at("a/b/c")).expect("made");
        create_directory(&at("a/b/c")).expect("there");
        fs::write(at("a/file"), b"content").expect("written");
        remove_empty_folder(&at("a"));
        assert!(at("a/file").exists());
        for _ in 0..2 {
            remove_file(&at("a/file")).expect("gone");
            remove_empty_folder(&at("a/b/c"));
            remove_folder(&at("a")).expect("gone");
        }
        assert!(!at("a").exists());
        fs::write(at("file"), b"content").expect("written");
        assert!(create_directory(&at("file/below")).is_err());
        assert!(remove_file(directory.path()).is_err());
    }
}
