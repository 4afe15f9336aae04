use crate::{FileError, ScratchFile, ScratchPlace};

/// Bytes that are appended once and read back at any position, in memory or in a nameless file: temporary data
/// that may exceed the memory.
#[derive(Debug)]
pub struct Spill {
    storage: Storage,
    bytes: u64,
}

#[derive(Debug)]
enum Storage {
    Heap(Vec<u8>),
    Disk(ScratchFile<u8>),
}

impl Spill {
    /// Creates an empty spill.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub fn new(place: &ScratchPlace) -> Result<Self, FileError> {
        let storage = match place {
            ScratchPlace::Memory => Storage::Heap(Vec::new()),
            ScratchPlace::Disk(directory) => Storage::Disk(ScratchFile::new(0, directory)?),
        };
        Ok(Self { storage, bytes: 0 })
    }

    /// Appends `bytes`, and returns the position of the first.
    ///
    /// # Errors
    /// If the disk is full.
    pub fn append(&mut self, bytes: &[u8]) -> Result<u64, FileError> {
        let at = self.bytes;
        match &mut self.storage {
            Storage::Heap(all) => all.extend_from_slice(bytes),
            Storage::Disk(file) => file.write(at as usize, bytes)?,
        }
        self.bytes += bytes.len() as u64;
        Ok(at)
    }

    /// Fills `bytes` from position `at` on.
    ///
    /// # Errors
    /// If the disk fails.
    ///
    /// # Panics
    /// If fewer bytes were appended.
    pub fn read(&self, at: u64, bytes: &mut [u8]) -> Result<(), FileError> {
        assert!(at + bytes.len() as u64 <= self.bytes, "only what was appended can be read");
        match &self.storage {
            Storage::Heap(all) => {
                let start = at as usize;
                bytes.copy_from_slice(&all[start..start + bytes.len()]);
                Ok(())
            }
            Storage::Disk(file) => file.read(at as usize, bytes),
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
        for place in [ScratchPlace::Memory, disk] {
            let mut spill = Spill::new(&place).expect("room");
            assert_eq!(spill.append(b"first").expect("room"), 0);
            let mut read = [0; 3];
            spill.read(1, &mut read).expect("there");
            assert_eq!(&read, b"irs");
            assert_eq!(spill.append(b"second").expect("room"), 5);
            let mut read = [0; 8];
            spill.read(3, &mut read).expect("there");
            assert_eq!(&read, b"stsecond");
        }
        let left = std::fs::read_dir(directory.path().join("new")).expect("readable").count();
        assert_eq!(left, 0, "working files have no name");
    }
}
