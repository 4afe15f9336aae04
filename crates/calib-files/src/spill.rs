use std::{
    borrow::Cow,
    fs::File,
    io::{Read as _, Seek as _, SeekFrom, Write as _},
    path::PathBuf,
    sync::{Mutex, PoisonError},
};

use crate::{FileError, ScratchPlace, create_directory};

/// Bytes of a word.
const WORD: u64 = size_of::<u64>() as u64;

/// Words that are appended once and read back from anywhere: in memory as far as they may be, and beyond that in a nameless
/// file. What is too much for the memory, and of no use to anybody later.
#[derive(Debug)]
pub struct Spill {
    /// What was appended first, in blocks as they came.
    kept: Vec<Block>,
    /// Words in `kept`; those from there on are in the file.
    kept_words: u64,
    /// Words that may be kept.
    most_kept: u64,
    file: Option<Working>,
    words: u64,
}

#[derive(Debug)]
struct Block {
    /// Its first word.
    at: u64,
    words: Vec<u64>,
}

#[derive(Debug)]
struct Working {
    file: Mutex<File>,
    directory: PathBuf,
}

impl Spill {
    /// Nothing yet. With a `place` on disk the first `kept_bytes` are kept in memory all the same: to write them costs as much
    /// as to read text.
    ///
    /// # Errors
    /// If the file cannot be made.
    pub fn new(place: &ScratchPlace, kept_bytes: u64) -> Result<Self, FileError> {
        let (most_kept, file) = match place {
            ScratchPlace::Memory => (u64::MAX, None),
            ScratchPlace::Disk(directory) => {
                create_directory(directory)?;
                let file = tempfile::tempfile_in(directory)
                    .map_err(|source| FileError::io("make a working file in", directory, source))?;
                let working = Working { file: Mutex::new(file), directory: directory.clone() };
                (kept_bytes / WORD, Some(working))
            }
        };
        Ok(Self { kept: Vec::new(), kept_words: 0, most_kept, file, words: 0 })
    }

    /// Append `words`; the number of the first of them. Owned words that are kept are not copied.
    ///
    /// # Errors
    /// If the disk is full.
    pub fn append<'a>(&mut self, words: impl Into<Cow<'a, [u64]>>) -> Result<u64, FileError> {
        let (at, words) = (self.words, words.into());
        let count = words.len() as u64;
        let fits = self.kept_words == at && at.saturating_add(count) <= self.most_kept;
        match &mut self.file {
            Some(Working { file, directory }) if !fits => {
                let file = file.get_mut().unwrap_or_else(PoisonError::into_inner);
                let place = SeekFrom::Start((at - self.kept_words) * WORD);
                file.seek(place)
                    .and_then(|_| file.write_all(bytemuck::cast_slice(&words)))
                    .map_err(|source| {
                        FileError::io("write a working file in", directory, source)
                    })?;
            }
            _ => {
                self.kept.push(Block { at, words: words.into_owned() });
                self.kept_words += count;
            }
        }
        self.words += count;
        Ok(at)
    }

    /// Read the words from number `at` on.
    ///
    /// # Errors
    /// If the disk fails.
    ///
    /// # Panics
    /// If so many were not appended.
    pub fn read(&self, at: u64, words: &mut [u64]) -> Result<(), FileError> {
        assert!(at + words.len() as u64 <= self.words, "only what was appended can be read");
        let in_memory = self.kept_words.saturating_sub(at).min(words.len() as u64) as usize;
        let (mut kept, rest) = words.split_at_mut(in_memory);
        let first = self.kept.partition_point(|block| block.at + block.words.len() as u64 <= at);
        let mut next = at;
        for block in &self.kept[first..] {
            let inside = &block.words[(next - block.at) as usize..];
            let count = inside.len().min(kept.len());
            let (filled, later) = kept.split_at_mut(count);
            filled.copy_from_slice(&inside[..count]);
            (kept, next) = (later, next + count as u64);
            if kept.is_empty() {
                break;
            }
        }
        match &self.file {
            Some(Working { file, directory }) if !rest.is_empty() => {
                let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
                file.seek(SeekFrom::Start((next.max(at) - self.kept_words) * WORD))
                    .and_then(|_| file.read_exact(bytemuck::cast_slice_mut(rest)))
                    .map_err(|source| FileError::io("read a working file in", directory, source))
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_appended_is_read_back_from_anywhere() {
        let directory = tempfile::tempdir().expect("a directory");
        let disk = ScratchPlace::Disk(directory.path().join("new"));
        for (place, kept_bytes) in
            [(ScratchPlace::Memory, 0), (disk.clone(), 0), (disk.clone(), 48), (disk, 1 << 20)]
        {
            let mut spill = Spill::new(&place, kept_bytes).expect("room");
            let mut next = 0;
            // Five words are kept of 48 bytes, and what follows them is not, however short.
            for count in [2, 3, 4, 1, 5] {
                let words: Vec<u64> = (next..next + count).collect();
                let at = if count % 2 == 0 { spill.append(words) } else { spill.append(&words) };
                assert_eq!(at.expect("room"), next);
                next += count;
            }
            for at in 0..next {
                for end in at..=next {
                    let mut read = vec![0; (end - at) as usize];
                    spill.read(at, &mut read).expect("there");
                    assert_eq!(read, (at..end).collect::<Vec<u64>>(), "{kept_bytes}");
                }
            }
        }
        let left = std::fs::read_dir(directory.path().join("new")).expect("readable").count();
        assert_eq!(left, 0, "working files have no name");
    }
}
