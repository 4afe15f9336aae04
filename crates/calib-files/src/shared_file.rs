//! A file that is opened once and read at many positions.

use std::{
    fs::File,
    io::{self, Read, Seek, SeekFrom},
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
};

use crate::{FileError, open_regular};

/// Maximum number of files that are held open. Systems allow a process 1,024 or fewer. Files beyond this number are
/// opened again for each reader.
const MOST: usize = 200;

static HELD: AtomicUsize = AtomicUsize::new(0);

/// A file for reading. If the file is replaced meanwhile, the old content is still read, as long as not too many files
/// are held.
#[derive(Debug)]
pub struct HeldFile {
    path: PathBuf,
    file: Option<Arc<File>>,
}

impl HeldFile {
    /// Opens the file at `path`, with the refusals of [`open_regular`].
    ///
    /// # Errors
    /// As [`open_regular`].
    pub fn open(path: &Path) -> Result<Self, FileError> {
        let file = open_regular(path)?;
        let path = path.to_owned();
        if HELD.fetch_add(1, Ordering::Relaxed) < MOST {
            return Ok(Self { path, file: Some(Arc::new(file)) });
        }
        HELD.fetch_sub(1, Ordering::Relaxed);
        Ok(Self { path, file: None })
    }

    /// Returns the file, for a library that maps it. All handles share one position: only one of them may be read or
    /// moved at a time.
    ///
    /// # Errors
    /// If it cannot be opened.
    pub fn file(&self) -> Result<File, FileError> {
        match &self.file {
            Some(file) => {
                file.try_clone().map_err(|source| FileError::io("read", &self.path, source))
            }
            None => open_regular(&self.path),
        }
    }

    /// Returns an independent reader, from byte `offset` on.
    ///
    /// # Errors
    /// If it cannot be opened.
    pub fn reader(&self, offset: u64) -> Result<HeldReader, FileError> {
        let file = match &self.file {
            Some(file) => Arc::clone(file),
            None => Arc::new(open_regular(&self.path)?),
        };
        Ok(HeldReader { file, offset })
    }
}

impl Drop for HeldFile {
    fn drop(&mut self) {
        if self.file.is_some() {
            HELD.fetch_sub(1, Ordering::Relaxed);
        }
    }
}

/// Reads a [`HeldFile`] from a position of its own.
#[derive(Debug)]
pub struct HeldReader {
    file: Arc<File>,
    offset: u64,
}

impl HeldReader {
    /// Returns the bytes of the file.
    ///
    /// # Errors
    /// If the system does not report them.
    pub fn len(&self) -> io::Result<u64> {
        Ok(self.file.metadata()?.len())
    }

    /// Whether the file has no bytes.
    ///
    /// # Errors
    /// If the system does not report them.
    pub fn is_empty(&self) -> io::Result<bool> {
        Ok(self.len()? == 0)
    }
}

impl Read for HeldReader {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        #[cfg(unix)]
        let read = std::os::unix::fs::FileExt::read_at(&*self.file, buffer, self.offset)?;
        #[cfg(windows)]
        let read = std::os::windows::fs::FileExt::seek_read(&*self.file, buffer, self.offset)?;
        self.offset += read as u64;
        Ok(read)
    }
}

impl Seek for HeldReader {
    fn seek(&mut self, place: SeekFrom) -> io::Result<u64> {
        let place = match place {
            SeekFrom::Start(offset) => Some(offset),
            SeekFrom::Current(by) => self.offset.checked_add_signed(by),
            SeekFrom::End(by) => self.len()?.checked_add_signed(by),
        };
        self.offset = place.ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.offset)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readers_have_positions_of_their_own() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("a");
        std::fs::write(&path, b"0123456789").expect("written");
        let held = HeldFile::open(&path).expect("there");
        let mut first = held.reader(2).expect("open");
        let mut second = held.reader(7).expect("open");
        let mut bytes = [0; 2];
        first.read_exact(&mut bytes).expect("there");
        assert_eq!(&bytes, b"23");
        second.read_exact(&mut bytes).expect("there");
        assert_eq!(&bytes, b"78");
        first.read_exact(&mut bytes).expect("there");
        assert_eq!(&bytes, b"45");
        assert_eq!(second.seek(SeekFrom::End(-1)).expect("inside"), 9);
        assert_eq!(second.seek(SeekFrom::Current(-4)).expect("inside"), 5);
        assert!(second.seek(SeekFrom::Current(-6)).is_err());
        assert_eq!((first.len().expect("known"), first.is_empty().expect("known")), (10, false));
        let mut rest = String::new();
        held.reader(8).expect("open").read_to_string(&mut rest).expect("text");
        assert_eq!(rest, "89");
    }

    #[test]
    fn more_files_than_are_held_are_read_all_the_same() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("a");
        std::fs::write(&path, b"content").expect("written");
        let all: Vec<HeldFile> =
            (0..2 * MOST).map(|_| HeldFile::open(&path).expect("there")).collect();
        assert!(all.iter().filter(|held| held.file.is_some()).count() <= MOST);
        for held in &all {
            let mut content = String::new();
            held.reader(0).expect("open").read_to_string(&mut content).expect("text");
            assert_eq!(content, "content");
            assert_eq!(held.file().expect("open").metadata().expect("known").len(), 7);
        }
    }
}
