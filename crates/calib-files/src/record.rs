//! What of a folder is calib's, written in the file that its lock is held on: what somebody else put there is neither
//! replaced nor removed, whatever it is called.

use std::{
    collections::BTreeSet,
    fs::{self, File},
    io::{self, Write as _},
    path::{Path, PathBuf},
};

use crate::{
    FileError, create_directory, disk::Announced, is_temporary, lock::open_lock, write_new,
};

/// The file in each folder.
pub const LOCK: &str = ".lock";

/// What the file begins with; a line a name follows.
const TITLE: &str =
    "calib keeps this file, and replaces and removes in this folder only what it names:\n";
/// Stands for everything in the folder.
const EVERYTHING: &str = "*";
/// What the name of a file outside of the folder begins with.
const OUTSIDE: &str = "../";

/// What of a folder is calib's.
#[derive(Clone, Debug)]
pub struct FolderRecord {
    folder: PathBuf,
    names: BTreeSet<String>,
}

impl FolderRecord {
    /// The record of `folder`: nothing is calib's where there is none.
    ///
    /// # Errors
    /// If there is one that cannot be read.
    pub fn read(folder: &Path) -> Result<Self, FileError> {
        let text = read(&folder.join(LOCK))?;
        let names = text.strip_prefix(TITLE).unwrap_or_default().lines().map(str::to_owned);
        Ok(Self { folder: folder.to_owned(), names: names.collect() })
    }

    /// The record of `folder`, which may be somebody's: it is made where there is none.
    ///
    /// # Errors
    /// [`FileError::Foreign`] if somebody else's file is called as the record is; or if it cannot be written.
    pub fn open(folder: &Path) -> Result<Self, FileError> {
        let record = Self::read(folder)?;
        record.make("")?;
        Ok(record)
    }

    /// As [`open`](Self::open), of a folder that must be new, empty, or have nothing in it but what its record names.
    ///
    /// # Errors
    /// [`FileError::ForeignFolder`] if there is something else in it; or if it cannot be written.
    pub fn open_own(folder: &Path) -> Result<Self, FileError> {
        Self::check(folder, || false)?;
        Self::open(folder)
    }

    /// Make `folder` calib's as a whole, which it is from then on. It must be new, empty or calib's already, or `is_ours`
    /// must know it.
    ///
    /// # Errors
    /// [`FileError::ForeignFolder`] if there is something else in it; or if it cannot be written.
    pub fn take(folder: &Path, is_ours: impl FnOnce() -> bool) -> Result<Self, FileError> {
        create_directory(folder)?;
        let mut record = Self::check(folder, is_ours)?;
        if fs::symlink_metadata(folder.join(LOCK)).is_err() {
            // At once, so that of several calibs one does it.
            record.make(&format!("{EVERYTHING}\n"))?;
            record = Self::read(folder)?;
        }
        if !record.names.contains(EVERYTHING) {
            match record.add([EVERYTHING]) {
                // The folder is known to be calib's, whatever became of the record.
                Err(FileError::Foreign { .. }) => drop(record.names.insert(EVERYTHING.to_owned())),
                added => added?,
            }
        }
        Ok(record)
    }

    /// Whether `folder` could be taken, which need not exist; nothing is written.
    ///
    /// # Errors
    /// As [`take`](Self::take).
    pub fn check(folder: &Path, is_ours: impl FnOnce() -> bool) -> Result<Self, FileError> {
        // Before the record is read: whoever makes a folder calib's writes the record before anything else, so that what
        // another calib has written here meanwhile is not taken for somebody's.
        let files = if Self::read(folder)?.names.contains(EVERYTHING) {
            Vec::new()
        } else {
            files(folder, "")?
        };
        let record = Self::read(folder)?;
        let foreign = files.into_iter().filter(|name| !record.has(name));
        // The same one each time.
        match foreign.min().filter(|_| !is_ours()) {
            Some(example) => Err(FileError::ForeignFolder { folder: folder.to_owned(), example }),
            None => Ok(record),
        }
    }

    /// The names that calib wrote.
    pub fn names(&self) -> &BTreeSet<String> {
        &self.names
    }

    /// Whether what is called `name` in the folder is calib's.
    pub fn has(&self, name: &str) -> bool {
        // Not even what is calib's as a whole reaches out of it.
        self.names.contains(name) || (self.names.contains(EVERYTHING) && !name.starts_with(OUTSIDE))
    }

    /// Note, before they are written, that files in this folder, or in one that they name the way to, are calib's.
    ///
    /// # Errors
    /// [`FileError::Foreign`] if one of them is there and somebody else's: then none is noted. Or if nothing can be written.
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
                // Where there are no locks, another calib may have noted and written it meanwhile.
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

    /// Note that files are calib's which are known to be.
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
            // A kill may have left half a line.
            Some(before) if !before.is_empty() && !before.ends_with('\n') => format!("\n{lines}"),
            Some(_) => lines,
            // Of a calib that noted nothing.
            None if there.is_empty() => format!("{TITLE}{lines}"),
            None => return Err(FileError::Foreign { path }),
        };
        append(&path, &text)?;
        self.names.extend(names);
        Ok(())
    }

    /// Make the file with these lines, unless it is there.
    fn make(&self, lines: &str) -> Result<(), FileError> {
        let path = self.folder.join(LOCK);
        if read(&path)?.starts_with(TITLE) {
            return Ok(());
        }
        match write_new(&path, |file| write!(file, "{TITLE}{lines}")) {
            // Another calib was faster.
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

/// Write `text` to an open file, and on to the disk.
fn write_through(file: &mut File, path: &Path, text: &str) -> io::Result<()> {
    let mut output = Announced::output(file, path);
    output.write_all(text.as_bytes())?;
    output.flush()?;
    output.get_ref().sync()
}

/// What the record says, as far as it is one: a link is somebody's, and so is what it leads to.
fn read(path: &Path) -> Result<String, FileError> {
    if !fs::symlink_metadata(path).is_ok_and(|found| found.is_file()) {
        return Ok(String::new());
    }
    let bytes = fs::read(path).map_err(|source| FileError::io("read", path, source))?;
    Ok(String::from_utf8(bytes).unwrap_or_default())
}

/// The names of what is in a folder and in those below, but for records and what a killed process leaves of a file.
fn files(folder: &Path, before: &str) -> Result<Vec<String>, FileError> {
    let refused = |source| FileError::io("read the folder", folder, source);
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(refused)?,
    };
    let mut found = Vec::new();
    for entry in entries {
        let entry = entry.map_err(refused)?;
        let path = entry.path();
        let name = format!("{before}{}", entry.file_name().to_string_lossy());
        if entry.file_type().map_err(refused)?.is_dir() {
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
        // Half a line of a kill stands for itself.
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
