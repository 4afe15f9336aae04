//! The only module that changes a disk. Each function announces its operation first, so that a test can make it fail.

use std::{
    fs::{self, File},
    io::{self, BufWriter, Write},
    path::Path,
};

use crate::{
    FileError,
    faults::{Operation, reach, reach_or_half},
};

/// The buffered writer for the content of a file.
pub type Output<'a> = BufWriter<Announced<'a>>;

/// A file whose writes are all announced.
#[derive(Debug)]
pub struct Announced<'a> {
    file: &'a mut File,
    path: &'a Path,
}

impl<'a> Announced<'a> {
    /// Returns a buffered writer to `file`, which is written for `path`.
    pub(crate) fn output(file: &'a mut File, path: &'a Path) -> Output<'a> {
        BufWriter::with_capacity(1 << 20, Self { file, path })
    }
}

impl Announced<'_> {
    /// Syncs the written data to the disk.
    pub(crate) fn sync(&self) -> io::Result<()> {
        reach(Operation::Sync, self.path)?;
        self.file.sync_all()
    }
}

impl Write for Announced<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        reach_or_half(Operation::Write, self.path, || {
            drop(self.file.write_all(&bytes[..bytes.len() / 2]));
        })?;
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Creates `path` and its parents, if they do not exist. Their names are on the disk when this returns.
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

/// Whether the path is empty: the working directory, as `parent` of a bare name returns it.
fn names_nothing(path: &Path) -> bool {
    path.as_os_str().is_empty()
}

fn make_folder(folder: &Path) -> io::Result<()> {
    reach(Operation::MakeFolder, folder)?;
    match fs::create_dir(folder) {
        // Another process created it first.
        Err(_) if folder.is_dir() => return Ok(()),
        other => other?,
    }
    sync_directory(directory_of(folder))
}

/// Returns the folder that holds `path`.
pub(crate) fn directory_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !names_nothing(parent) => parent,
        _ => Path::new("."),
    }
}

/// Syncs a directory. Without this a renamed file may be lost in a power failure: its name is the directory's content.
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

/// Removes a file, if it exists.
///
/// # Errors
/// If it exists and cannot be removed.
pub fn remove_file(path: &Path) -> Result<(), FileError> {
    match reach(Operation::Remove, path).and_then(|()| fs::remove_file(path)) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        removed => removed.map_err(|source| FileError::io("remove", path, source)),
    }
}

/// Removes the files below `folder` for which `is_ours` is true, given their path in it, and folders that become empty.
/// All other files and links are kept, and so are the targets of links. A missing folder is no error.
///
/// # Errors
/// If a file exists and cannot be removed, or a folder cannot be read.
pub fn remove_known(
    folder: &Path,
    is_ours: &mut dyn FnMut(&Path) -> bool,
) -> Result<(), FileError> {
    remove_below(folder, Path::new(""), is_ours)
}

fn remove_below(
    folder: &Path,
    inside: &Path,
    is_ours: &mut dyn FnMut(&Path) -> bool,
) -> Result<(), FileError> {
    if !fs::symlink_metadata(folder).is_ok_and(|found| found.is_dir()) {
        return Ok(());
    }
    let entries =
        fs::read_dir(folder).map_err(|source| FileError::unreadable_folder(folder, source))?;
    for entry in entries {
        let entry = entry.map_err(|source| FileError::unreadable_folder(folder, source))?;
        let path = inside.join(entry.file_name());
        let kind =
            entry.file_type().map_err(|source| FileError::unreadable_folder(folder, source))?;
        if kind.is_dir() {
            remove_below(&entry.path(), &path, is_ours)?;
        } else if kind.is_file() && is_ours(&path) {
            remove_file(&entry.path())?;
        }
    }
    remove_empty_folder(folder);
    Ok(())
}

/// A new folder in the system's folder for temporary files. It is removed when the value is dropped.
#[derive(Debug)]
pub struct TemporaryFolder(tempfile::TempDir);

impl TemporaryFolder {
    /// Creates the folder.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn new() -> Result<Self, FileError> {
        let place = std::env::temp_dir();
        let made = tempfile::Builder::new().prefix("calib-").tempdir_in(&place);
        made.map(Self).map_err(|source| FileError::io("create a folder in", &place, source))
    }

    /// Returns the path of the folder.
    pub fn path(&self) -> &Path {
        self.0.path()
    }
}

/// Removes a folder if it is empty. Otherwise, or if it cannot be removed, it is kept.
pub fn remove_empty_folder(path: &Path) {
    let _ = reach(Operation::Remove, path).and_then(|()| fs::remove_dir(path));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn what_is_not_known_stays() {
        let directory = tempfile::tempdir().expect("a directory");
        let at = |name: &str| directory.path().join(name);
        let ours = ["a/b/1.part", "a/2.part"];
        let foreign = ["a/c/notes.txt", "a/3.part", "elsewhere/4.part"];
        for name in ours.iter().chain(&foreign) {
            create_directory(at(name).parent().expect("below")).expect("made");
            fs::write(at(name), b"content").expect("written");
        }
        std::os::unix::fs::symlink(at("elsewhere"), at("a/linked")).expect("linked");
        std::os::unix::fs::symlink(at("elsewhere/4.part"), at("a/4.part")).expect("linked");
        remove_known(&at("a"), &mut |path| path.ends_with("1.part") || path == Path::new("2.part"))
            .expect("removed");
        assert!(ours.iter().all(|name| !at(name).exists()) && !at("a/b").exists());
        assert!(foreign.iter().all(|name| at(name).exists()));
        assert!(at("a/linked").exists() && at("a/4.part").exists());
        remove_known(&at("a/linked"), &mut |_| true).expect("nothing of ours");
        assert!(at("elsewhere/4.part").exists());
    }

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
            remove_known(&at("a"), &mut |_| true).expect("gone");
        }
        assert!(!at("a").exists());
        fs::write(at("file"), b"content").expect("written");
        assert!(create_directory(&at("file/below")).is_err());
        assert!(remove_file(directory.path()).is_err());
    }
}
