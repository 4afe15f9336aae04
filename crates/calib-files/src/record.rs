//! The record of calib's files in a folder, written in the lock file. All other files are neither replaced nor removed,
//! whatever their names.

use std::{
    collections::BTreeSet,
    fs::{self, File},
    io::{self, Write as _},
    path::{Path, PathBuf},
};

use crate::{
    FileError, create_directory, disk::Announced, is_temporary, lock::open_lock, write_new,
};

/// Name of the file in each folder.
pub const LOCK: &str = ".lock";

/// First line of the file. One name per line follows.
const TITLE: &str =
    "calib keeps this file, and replaces and removes in this folder only what it names:\n";
/// Stands for everything in the folder.
const EVERYTHING: &str = "*";
/// Prefix of the name of a file outside the folder.
const OUTSIDE: &str = "../";

/// The names of calib's files in a folder.
#[derive(Clone, Debug)]
pub struct FolderRecord {
    folder: PathBuf,
    names: BTreeSet<String>,
}

impl FolderRecord {
    /// Reads the record of `folder`. Without a record, no file is calib's.
    ///
    /// # Errors
    /// If the record exists and cannot be read.
    pub fn read(folder: &Path) -> Result<Self, FileError> {
        let text = read(&folder.join(LOCK))?;
        let names = text.strip_prefix(TITLE).unwrap_or_default().lines().map(str::to_owned);
        Ok(Self { folder: folder.to_owned(), names: names.collect() })
    }

    /// Opens the record of `folder`, which may also hold other files. It is created if it does not exist.
    ///
    /// # Errors
    /// [`FileError::Foreign`] if a file with the record's name is not calib's; or if it cannot be written.
    pub fn open(folder: &Path) -> Result<Self, FileError> {
        let record = Self::read(folder)?;
        record.make("")?;
        Ok(record)
    }

    /// Opens the record as [`open`](Self::open) does. The folder must be new, empty, or hold only files that its record
    /// names.
    ///
    /// # Errors
    /// [`FileError::ForeignFolder`] if it holds other files; or if it cannot be written.
    pub fn open_own(folder: &Path) -> Result<Self, FileError> {
        Self::check(folder, || false)?;
        Self::open(folder)
    }

    /// Makes the whole of `folder` calib's from now on. It must be new, empty or calib's already, or `is_ours` must
    /// recognise it.
    ///
    /// # Errors
    /// [`FileError::ForeignFolder`] if it holds other files; or if it cannot be written.
    pub fn take(folder: &Path, is_ours: impl FnOnce() -> bool) -> Result<Self, FileError> {
        create_directory(folder)?;
        let mut record = Self::check(folder, is_ours)?;
        if fs::symlink_metadata(folder.join(LOCK)).is_err() {
            // In one operation, so that only one of several calib processes does it.
            record.make(&format!("{EVERYTHING}\n"))?;
            record = Self::read(folder)?;
        }
        if !record.names.contains(EVERYTHING) {
            match record.add([EVERYTHING]) {
                // The folder is known to be calib's, whatever happened to the record.
                Err(FileError::Foreign { .. }) => drop(record.names.insert(EVERYTHING.to_owned())),
                added => added?,
            }
        }
        Ok(record)
    }

    /// Checks whether `folder`, which need not exist, could be taken. Nothing is written.
    ///
    /// # Errors
    /// As [`take`](Self::take).
    pub fn check(folder: &Path, is_ours: impl FnOnce() -> bool) -> Result<Self, FileError> {
        // The files are listed before the record is read. A process that takes a folder writes the record before
        // anything else, so files that another calib has written meanwhile are not mistaken for foreign ones.
        let files = if Self::read(folder)?.names.contains(EVERYTHING) {
            Vec::new()
        } else {
            files(folder, "")?
        };
        let record = Self::read(folder)?;
        let foreign = files.into_iter().filter(|name| !record.has(name));
        // The minimum, so that the message is always the same.
        match foreign.min().filter(|_| !is_ours()) {
            Some(example) => Err(FileError::ForeignFolder { folder: folder.to_owned(), example }),
            None => Ok(record),
        }
    }

    /// Returns the names that calib wrote.
    pub fn names(&self) -> &BTreeSet<String> {
        &self.names
    }

    /// Whether the file `name` in the folder is calib's.
    pub fn has(&self, name: &str) -> bool {
        // Even a folder that is calib's as a whole does not cover files outside it.
        self.names.contains(name) || (self.names.contains(EVERYTHING) && !name.starts_with(OUTSIDE))
    }

    /// Records that files in this folder, or outside it by a relative path, are calib's. Call it before they are
    /// written.
    ///
    /// # Errors
    /// [`FileError::Foreign`] if one of them exists and is not calib's; then none is recorded. Or if nothing can be
    /// written.
    pub fn note<S: Into<String>>(
        &mut self,
        names: impl IntoIterator<Item = S>,
    ) -> Result<(), FileError> {
        let mut new = Vec::new();
        for name in names {
            let name: String = name.into();
            if self.has(&name) {
                continue;
            }
            let path = self.folder.join(&name);
            if fs::symlink_metadata(&path).is_ok() {
                // Without locks, another calib may have recorded and written it meanwhile.
                self.names.extend(Self::read(&self.folder)?.names);
                if self.has(&name) {
                    continue;
                }
                return Err(FileError::Foreign { path });
            }
            new.push(name);
        }
        if new.is_empty() {
            return Ok(());
        }
        self.make("")?;
        self.add(new)
    }

    /// Records files that are known to be calib's.
    ///
    /// # Errors
    /// If nothing can be written.
    pub fn add<S: Into<String>>(
        &mut self,
        names: impl IntoIterator<Item = S>,
    ) -> Result<(), FileError> {
        let path = self.folder.join(LOCK);
        let names = names.into_iter().map(Into::into);
        let names: Vec<String> = names.filter(|name| !self.names.contains(name)).collect();
        if names.is_empty() {
            return Ok(());
        }
        let lines = names.iter().fold(String::new(), |lines, name| lines + name + "\n");
        if fs::symlink_metadata(&path).is_err() {
            self.make("")?;
        }
        let there = read(&path)?;
        let text = match there.strip_prefix(TITLE) {
            // A killed process may have left half a line.
            Some(before) if !before.is_empty() && !before.ends_with('\n') => format!("\n{lines}"),
            Some(_) => lines,
            // The file was written by a calib that kept no record.
            None if there.is_empty() => format!("{TITLE}{lines}"),
            None => return Err(FileError::Foreign { path }),
        };
        append(&path, &text)?;
        self.names.extend(names);
        Ok(())
    }

    /// Creates the file with these lines, unless it exists.
    fn make(&self, lines: &str) -> Result<(), FileError> {
        let path = self.folder.join(LOCK);
        if read(&path)?.starts_with(TITLE) {
            return Ok(());
        }
        match write_new(&path, |file| write!(file, "{TITLE}{lines}")) {
            // Another calib created it first.
            Err(FileError::Occupied { .. }) if read(&path)?.starts_with(TITLE) => Ok(()),
            Err(FileError::Occupied { path }) => Err(FileError::Foreign { path }),
            made => made,
        }
    }
}

fn append(path: &Path, text: &str) -> Result<(), FileError> {
    let mut file = open_lock(path)?;
    write_through(&mut file, path, text).map_err(|source| FileError::io("write", path, source))
}

/// Writes `text` to an open file, and syncs it to the disk.
fn write_through(file: &mut File, path: &Path, text: &str) -> io::Result<()> {
    let mut output = Announced::output(file, path);
    output.write_all(text.as_bytes())?;
    output.flush()?;
    output.get_ref().sync()
}

/// Reads the text of the record. A link is not a record: it and its target are not calib's.
fn read(path: &Path) -> Result<String, FileError> {
    if !fs::symlink_metadata(path).is_ok_and(|found| found.is_file()) {
        return Ok(String::new());
    }
    let bytes = fs::read(path).map_err(|source| FileError::io("read", path, source))?;
    Ok(String::from_utf8(bytes).unwrap_or_default())
}

/// Returns the names of the files in a folder and its subfolders, without records and temporary files of killed
/// processes.
fn files(folder: &Path, before: &str) -> Result<Vec<String>, FileError> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(|source| FileError::unreadable_folder(folder, source))?,
    };
    let mut found = Vec::new();
    for entry in entries {
        let entry = entry.map_err(|source| FileError::unreadable_folder(folder, source))?;
        let kind =
            entry.file_type().map_err(|source| FileError::unreadable_folder(folder, source))?;
        let path = entry.path();
        let name = format!("{before}{}", entry.file_name().to_string_lossy());
        if kind.is_dir() {
            found.extend(files(&path, &format!("{name}/"))?);
        } else if !(is_temporary(&path) || name == LOCK && read(&path)?.starts_with(TITLE)) {
            found.push(name);
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(folder: &Path, name: &str) {
        let path = folder.join(name);
        create_directory(path.parent().expect("below")).expect("made");
        fs::write(path, b"somebody's").expect("written");
    }

    #[test]
    fn a_new_folder_is_taken_and_stays() {
        let directory = tempfile::tempdir().expect("a directory");
        let folder = directory.path().join("new/folder");
        FolderRecord::take(&folder, || false).expect("nothing is there");
        write(&folder, "result");
        let record = FolderRecord::take(&folder, || false).expect("it is calib's");
        assert!(record.has("result"));
        assert!(FolderRecord::read(&folder).expect("readable").has("another"));
    }

    #[test]
    fn a_folder_of_somebody_is_refused_and_left_as_it_is() {
        let directory = tempfile::tempdir().expect("a directory");
        for name in ["notes.txt", LOCK, "below/deep.txt", ".hidden"] {
            let folder = directory.path().join(name.replace('/', "-"));
            write(&folder, name);
            let refused = FolderRecord::take(&folder, || false).expect_err("foreign").to_string();
            assert!(refused.contains("calib did not write"), "{refused}");
            assert_eq!(fs::read_dir(&folder).expect("readable").count(), 1);
            assert_eq!(fs::read(folder.join(name)).expect("readable"), b"somebody's");
        }
        let folder = directory.path().join("empty");
        write(&folder, LOCK);
        fs::write(folder.join(LOCK), b"").expect("written");
        assert!(FolderRecord::take(&folder, || false).is_err(), "an empty file is a file");
        let mut record = FolderRecord::read(&folder).expect("readable");
        assert!(record.note(["ours"]).is_err() && FolderRecord::open(&folder).is_err());
        assert_eq!(fs::read(folder.join(LOCK)).expect("readable"), b"");
        let known = directory.path().join("notes.txt");
        FolderRecord::take(&known, || true).expect("known by what is in it");
    }

    #[test]
    fn only_what_was_noted_may_be_replaced() {
        let directory = tempfile::tempdir().expect("a directory");
        let folder = directory.path();
        write(folder, "theirs");
        let mut record = FolderRecord::read(folder).expect("nothing");
        record.note(["ours", "below/ours"]).expect("not there");
        write(folder, "ours");
        let mut record = FolderRecord::read(folder).expect("readable");
        record.note(["ours", "below/ours", "further"]).expect("noted before");
        let refused = record.note(["another", "theirs"]).expect_err("foreign").to_string();
        assert!(refused.contains("theirs is in the way"), "{refused}");
        assert!(!FolderRecord::read(folder).expect("readable").has("another"));
        write(folder, "another");
        assert!(record.note(["another"]).is_err());
        // Half a line of a killed process counts as a name of its own.
        let path = folder.join(LOCK);
        let text = fs::read_to_string(&path).expect("readable");
        fs::write(&path, &text[..text.len() - 3]).expect("written");
        record.note(["last"]).expect("not there");
        let names = FolderRecord::read(folder).expect("readable");
        assert!(names.has("last") && names.has("ours") && !names.has("further"));
    }

    #[test]
    fn what_another_calib_has_noted_meanwhile_is_calibs() {
        let directory = tempfile::tempdir().expect("a directory");
        let folder = directory.path();
        let mut one = FolderRecord::open_own(folder).expect("nothing is there");
        let mut other = FolderRecord::open_own(folder).expect("nothing is there");
        one.note(["ours"]).expect("not there");
        write(folder, "ours");
        other.note(["ours"]).expect("noted by the other one");
        write(folder, "theirs");
        assert!(other.note(["theirs"]).is_err());
    }

    #[test]
    fn a_folder_of_calib_reaches_no_further() {
        let directory = tempfile::tempdir().expect("a directory");
        write(directory.path(), "page.html");
        let folder = directory.path().join("own");
        let mut record = FolderRecord::take(&folder, || false).expect("new");
        assert!(record.note(["../page.html"]).is_err());
        record.note(["../other.html", "inside"]).expect("not there");
    }
}
