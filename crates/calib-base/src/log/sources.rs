//! File-system metadata of the files of a log, which reveal a change without reading them.

use std::{
    collections::HashSet,
    ffi::OsStr,
    fs,
    path::{Path, PathBuf},
};

use calib_data::DataConfig;
use calib_files::{FileStat, read_sealed_json, write_sealed_json};
use serde::{Deserialize, Serialize};

use crate::{Context as _, StepError};

/// The file of these metadata. They differ between readings of the same log, so they have their own file.
pub(super) const SOURCES: &str = "sources.json";

/// The files of a log.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub struct Sources {
    pub(super) files: Vec<SourceFile>,
}

/// A file of a log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct SourceFile {
    path: PathBuf,
    #[serde(flatten)]
    pub(super) stamp: Option<FileStat>,
}

impl Sources {
    /// Returns the present metadata of the log that `data` names.
    ///
    /// # Errors
    /// If there are no files, or the metadata of one cannot be read.
    pub fn of(data: &DataConfig) -> Result<Self, StepError> {
        let files = calib_data::log_files(data)?.into_iter();
        Ok(Self {
            files: files
                .map(|path| {
                    let path = fs::canonicalize(&path)
                        .with_context(|| format!("cannot read {}", path.display()))?;
                    Ok(SourceFile { stamp: FileStat::of(&path)?, path })
                })
                .collect::<Result<_, StepError>>()?,
        })
    }

    /// Reads the metadata that were stored in a directory, if there are any.
    pub fn noted_in(directory: &Path) -> Option<Self> {
        read_sealed_json(&directory.join(SOURCES)).ok()
    }

    /// Stores the metadata in a directory.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn note_in(&self, directory: &Path) -> Result<(), StepError> {
        Ok(write_sealed_json(&directory.join(SOURCES), self)?)
    }

    /// Whether the files are certainly the same and unchanged. They never are where the system reports no metadata.
    pub fn are_unchanged_since(&self, noted: &Self) -> bool {
        self == noted && self.files.iter().all(|file| file.stamp.is_some())
    }

    /// Whether there are other files, or one has another size or modification time. Files that were moved, or copied
    /// with their times, count as the same.
    pub fn differ_from(&self, others: &Self) -> bool {
        let own = self.files.iter().map(SourceFile::size_and_time);
        own.ne(others.files.iter().map(SourceFile::size_and_time))
    }

    /// Returns a file that these lack with the same name, size and modification time, or one that `now` lacks. `None` if there is no
    /// such file.
    pub(super) fn changed_file<'a>(&'a self, now: &'a Self) -> Option<&'a Path> {
        let file = now.file_not_in(self).or_else(|| self.file_not_in(now))?;
        Some(&file.path)
    }

    /// Returns the first file that `others` lack with the same name, size and modification time.
    fn file_not_in(&self, others: &Self) -> Option<&SourceFile> {
        let known: HashSet<_> = others.files.iter().map(SourceFile::name_size_and_time).collect();
        self.files.iter().find(|file| !known.contains(&file.name_size_and_time()))
    }
}

impl SourceFile {
    /// Returns bytes, and nanoseconds since 1970, or `None` where the system does not report them.
    fn size_and_time(&self) -> Option<(u64, i64)> {
        self.stamp.map(|stamp| (stamp.bytes, stamp.modified_ns))
    }

    /// Returns the name without its folders, and [`Self::size_and_time`].
    fn name_size_and_time(&self) -> (Option<&OsStr>, Option<(u64, i64)>) {
        (self.path.file_name(), self.size_and_time())
    }

    /// Whether the file has not changed.
    pub(super) fn is_same(&self) -> bool {
        self.stamp.is_some() && FileStat::of(&self.path).is_ok_and(|stamp| stamp == self.stamp)
    }

    /// Whether any later change must have given it another stamp.
    pub(super) fn was_older_than(&self, other: &FileStat) -> bool {
        self.stamp.is_some_and(|stamp| {
            stamp.changed_ns.saturating_add(stamp.tick_ns()) < other.changed_ns
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(path: &str, bytes: u64, modified_ns: i64, inode: u64) -> Sources {
        let stamp = Some(FileStat { bytes, modified_ns, changed_ns: 9, inode });
        Sources { files: vec![SourceFile { path: path.into(), stamp }] }
    }

    #[test]
    fn a_log_is_another_one_by_size_or_time() {
        let log = file("a/log.csv", 100, 5, 1);
        assert!(!log.differ_from(&file("b/log.csv", 100, 5, 2)), "it was moved");
        assert!(log.differ_from(&file("a/log.csv", 101, 5, 1)));
        assert!(log.differ_from(&file("a/log.csv", 100, 6, 1)));
        assert!(log.differ_from(&Sources { files: Vec::new() }));
        assert_eq!(log.changed_file(&file("b/log.csv", 100, 5, 2)), None, "it was moved");
        for (now, changed) in [
            (file("b/log.csv", 100, 6, 1), "b/log.csv"),
            (file("b/other.csv", 100, 5, 1), "b/other.csv"),
            (Sources { files: Vec::new() }, "a/log.csv"),
        ] {
            assert_eq!(log.changed_file(&now), Some(Path::new(changed)));
        }
        let place = tempfile::tempdir().expect("a directory");
        assert!(Sources::noted_in(place.path()).is_none());
        log.note_in(place.path()).expect("writable");
        assert_eq!(Sources::noted_in(place.path()), Some(log));
    }
}
