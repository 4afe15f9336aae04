use std::{
    fs::File,
    io::{self, Write as _},
    marker::PhantomData,
    ops::{Deref, DerefMut},
    path::{Path, PathBuf},
};

use bytemuck::{Pod, Zeroable};
use memmap2::MmapMut;

use crate::{
    FileError, create_directory,
    faults::{Operation, reach},
};

/// The place of working arrays.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum ScratchPlace {
    /// In memory.
    #[default]
    Memory,
    /// In nameless, mapped files in this directory. The system may write them out and read them back, so they take
    /// memory only as long as it is free. They are removed with the process, however it ends.
    Disk(PathBuf),
}

/// A working array of zeros, in memory or in a file.
#[derive(Debug)]
pub struct Scratch<T> {
    storage: Storage<T>,
}

#[derive(Debug)]
enum Storage<T> {
    Heap(Vec<T>),
    Mapped(MmapMut, PhantomData<T>),
}

impl<T: Pod + Zeroable> Scratch<T> {
    /// Allocates `len` zeros.
    ///
    /// # Errors
    /// If the file cannot be created, or there is not enough disk space.
    pub fn zeroed(len: usize, place: &ScratchPlace) -> Result<Self, FileError> {
        let storage = match place {
            ScratchPlace::Memory => Storage::Heap(vec![T::zeroed(); len]),
            // An empty file cannot be mapped.
            ScratchPlace::Disk(_) if len == 0 => Storage::Heap(Vec::new()),
            ScratchPlace::Disk(directory) => {
                create_directory(directory)?;
                let map = map_nameless(directory, len * size_of::<T>())
                    .map_err(|source| FileError::io("make a working file in", directory, source))?;
                Storage::Mapped(map, PhantomData)
            }
        };
        Ok(Self { storage })
    }
}

/// A nameless file of numbers that are written and read in pieces at any position. When memory is short, reading
/// distant pieces of a mapped file reads it many times over, because the system reads ahead of each piece.
#[derive(Debug)]
pub struct ScratchFile<T> {
    file: File,
    directory: PathBuf,
    element: PhantomData<T>,
}

impl<T: Pod> ScratchFile<T> {
    /// Creates a file in `directory`, with room for `len` numbers.
    ///
    /// # Errors
    /// If the file cannot be created, or there is not enough disk space.
    pub fn new(len: usize, directory: &Path) -> Result<Self, FileError> {
        create_directory(directory)?;
        let file = nameless(directory, len * size_of::<T>())
            .map_err(|source| FileError::io("make a working file in", directory, source))?;
        Ok(Self { file, directory: directory.to_owned(), element: PhantomData })
    }

    /// Writes `values` from the position of number `first` on.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn write(&self, first: usize, values: &[T]) -> Result<(), FileError> {
        write_all_at(&self.file, bytemuck::cast_slice(values), first * size_of::<T>())
            .map_err(|source| FileError::io("write a working file in", &self.directory, source))
    }

    /// Fills `values` from the position of number `first` on.
    ///
    /// # Errors
    /// If the disk refuses, or there are not enough numbers.
    pub fn read(&self, first: usize, values: &mut [T]) -> Result<(), FileError> {
        read_exact_at(&self.file, bytemuck::cast_slice_mut(values), first * size_of::<T>())
            .map_err(|source| FileError::io("read a working file in", &self.directory, source))
    }
}

#[cfg(unix)]
fn write_all_at(file: &File, bytes: &[u8], offset: usize) -> io::Result<()> {
    std::os::unix::fs::FileExt::write_all_at(file, bytes, offset as u64)
}

#[cfg(unix)]
fn read_exact_at(file: &File, bytes: &mut [u8], offset: usize) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, offset as u64)
}

#[cfg(windows)]
fn write_all_at(file: &File, mut bytes: &[u8], mut offset: usize) -> io::Result<()> {
    while !bytes.is_empty() {
        let written = std::os::windows::fs::FileExt::seek_write(file, bytes, offset as u64)?;
        (bytes, offset) = (&bytes[written..], offset + written);
    }
    Ok(())
}

#[cfg(windows)]
fn read_exact_at(file: &File, mut bytes: &mut [u8], mut offset: usize) -> io::Result<()> {
    while !bytes.is_empty() {
        let read = std::os::windows::fs::FileExt::seek_read(file, bytes, offset as u64)?;
        if read == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        (bytes, offset) = (&mut bytes[read..], offset + read);
    }
    Ok(())
}

/// Creates a nameless file of `bytes` bytes.
fn nameless(directory: &Path, bytes: usize) -> io::Result<File> {
    reach(Operation::Reserve, directory)?;
    let mut file = tempfile::tempfile_in(directory)?;
    reserve(&mut file, bytes)?;
    Ok(file)
}

fn map_nameless(directory: &Path, bytes: usize) -> io::Result<MmapMut> {
    let file = nameless(directory, bytes)?;
    // SAFETY: the file has no name, and this process has the only handle: no other process changes it.
    #[expect(unsafe_code, reason = "memory-mapping a file is unsafe by nature")]
    unsafe {
        MmapMut::map_mut(&file)
    }
}

/// Reserves the disk space now: a full disk must be an error here, not a fault where the array is used.
fn reserve(file: &mut File, bytes: usize) -> io::Result<()> {
    // The system refuses to reserve 0 bytes.
    #[cfg(target_os = "linux")]
    if bytes > 0 {
        use rustix::fs::{FallocateFlags, fallocate};
        match fallocate(&*file, FallocateFlags::empty(), 0, bytes as u64) {
            Ok(()) => return Ok(()),
            Err(rustix::io::Errno::OPNOTSUPP | rustix::io::Errno::NOSYS) => {}
            Err(error) => return Err(error.into()),
        }
    }
    let zeros = vec![0; 1 << 20];
    let mut left = bytes;
    while left > 0 {
        let part = left.min(zeros.len());
        file.write_all(&zeros[..part])?;
        left -= part;
    }
    Ok(())
}

impl<T: Pod> Deref for Scratch<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        match &self.storage {
            Storage::Heap(values) => values,
            Storage::Mapped(map, _) => bytemuck::cast_slice(map),
        }
    }
}

impl<T: Pod> DerefMut for Scratch<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        match &mut self.storage {
            Storage::Heap(values) => values,
            Storage::Mapped(map, _) => bytemuck::cast_slice_mut(map),
        }
    }
}

impl<T: Pod> AsRef<[T]> for Scratch<T> {
    fn as_ref(&self) -> &[T] {
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zeros_that_can_be_written_in_memory_and_on_disk() {
        let directory = tempfile::tempdir().expect("a directory");
        let disk = ScratchPlace::Disk(directory.path().join("new"));
        for place in [ScratchPlace::Memory, disk] {
            let mut array = Scratch::<u32>::zeroed(100_000, &place).expect("room");
            assert!(array.iter().all(|&value| value == 0));
            array[99_999] = 7;
            assert_eq!((array.len(), array.as_ref()[99_999]), (100_000, 7));
            assert!(Scratch::<f32>::zeroed(0, &place).expect("nothing").is_empty());
        }
        let left = std::fs::read_dir(directory.path().join("new")).expect("readable").count();
        assert_eq!(left, 0, "working files have no name");
    }

    #[test]
    fn pieces_of_a_file_are_written_and_read_wherever_they_lie() {
        let directory = tempfile::tempdir().expect("a directory");
        let file = ScratchFile::<u32>::new(100, directory.path()).expect("room");
        file.write(90, &[1, 2, 3]).expect("room");
        file.write(0, &[4]).expect("room");
        let mut read = [9; 4];
        file.read(89, &mut read).expect("there");
        assert_eq!(read, [0, 1, 2, 3]);
        assert!(file.read(98, &mut read).is_err(), "there are only 100");
        let empty = ScratchFile::<u32>::new(0, directory.path()).expect("nothing");
        empty.read(0, &mut []).expect("nothing");
    }

    #[test]
    fn a_disk_that_is_too_small_is_an_error_at_once() {
        let directory = tempfile::tempdir().expect("a directory");
        let place = ScratchPlace::Disk(directory.path().to_owned());
        let error = Scratch::<f32>::zeroed(1 << 58, &place).expect_err("more than any disk");
        assert!(error.to_string().contains("working file"), "{error}");
    }
}
