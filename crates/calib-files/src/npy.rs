use std::{io::Write as _, marker::PhantomData, path::Path};

use bytemuck::Pod;
use memmap2::Mmap;

use crate::{FileError, mapped::Known, npy_header::NpyHeader, open_regular, write_atomically};

/// A number type that calib stores in NumPy files.
pub trait NpyElement: Pod {
    /// NumPy's name of the type, little-endian.
    const DESCRIPTION: &'static str;
}

impl NpyElement for f32 {
    const DESCRIPTION: &'static str = "<f4";
}

impl NpyElement for f64 {
    const DESCRIPTION: &'static str = "<f8";
}

impl NpyElement for i64 {
    const DESCRIPTION: &'static str = "<i8";
}

impl NpyElement for u32 {
    const DESCRIPTION: &'static str = "<u4";
}

const MAGIC: &[u8] = b"\x93NUMPY\x01\x00";

fn header<T: NpyElement>(rows: usize, columns: usize) -> Vec<u8> {
    let dictionary = format!(
        "{{'descr': '{}', 'fortran_order': False, 'shape': ({rows}, {columns}), }}",
        T::DESCRIPTION
    );
    // Magic, length, dictionary and newline together are padded so that the data are aligned to 64
    // bytes.
    let unpadded = MAGIC.len() + 2 + dictionary.len() + 1;
    let padding = unpadded.next_multiple_of(64) - unpadded;
    let length = (dictionary.len() + padding + 1) as u16;
    let mut header = Vec::with_capacity(unpadded + padding);
    header.extend_from_slice(MAGIC);
    header.extend_from_slice(&length.to_le_bytes());
    header.extend_from_slice(dictionary.as_bytes());
    header.resize(unpadded + padding - 1, b' ');
    header.push(b'\n');
    header
}

/// Writes a `[rows, columns]` array, row-major, in NumPy's format 1.0, atomically.
///
/// # Errors
/// If the file cannot be written.
///
/// # Panics
/// If there are not `rows * columns` values.
pub fn write_npy<T: NpyElement>(
    path: &Path,
    values: &[T],
    rows: usize,
    columns: usize,
) -> Result<(), FileError> {
    assert_eq!(values.len(), rows * columns, "an array has rows x columns values");
    write_atomically(path, |file| {
        file.write_all(&header::<T>(rows, columns))?;
        file.write_all(bytemuck::cast_slice(values))
    })
}

/// A two-dimensional array in a mapped file.
#[derive(Debug)]
pub struct MappedNpy<T> {
    /// Dropped before the file is unmapped.
    _known: Known,
    map: Mmap,
    offset: usize,
    rows: usize,
    columns: usize,
    element: PhantomData<T>,
}

impl<T: NpyElement> MappedNpy<T> {
    /// Returns the number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Returns the number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Returns all values, row-major.
    pub fn as_slice(&self) -> &[T] {
        bytemuck::cast_slice(&self.map[self.offset..])
    }
}

impl<T: NpyElement> AsRef<[T]> for MappedNpy<T> {
    fn as_ref(&self) -> &[T] {
        self.as_slice()
    }
}

/// Maps an array that [`write_npy`] (or NumPy, row-major) wrote.
///
/// # Errors
/// If the file cannot be read, has another element type or shape, or is truncated.
pub fn map_npy<T: NpyElement>(path: &Path) -> Result<MappedNpy<T>, FileError> {
    let file = open_regular(path)?;
    // SAFETY: files of a model directory are replaced by renaming, never changed in place,
    // so a map keeps the content that it was opened with.
    #[expect(unsafe_code, reason = "memory-mapping a file is unsafe by nature")]
    let map = unsafe { Mmap::map(&file) }.map_err(|source| FileError::io("map", path, source))?;
    let header = NpyHeader::parse(&map).map_err(|reason| FileError::npy(path, reason))?;
    if header.description != T::DESCRIPTION {
        let expected = T::DESCRIPTION;
        let got = header.description;
        let reason = format!("expected elements of type '{expected}', got '{got}'");
        return Err(FileError::npy(path, reason));
    }
    if header.is_column_major {
        let reason = "expected row-major (C) order, got Fortran order".to_owned();
        return Err(FileError::npy(path, reason));
    }
    let &[rows, columns] = &header.shape[..] else {
        let reason = format!("expected a shape of two dimensions, got {:?}", header.shape);
        return Err(FileError::npy(path, reason));
    };
    let offset = header.data;
    let expected = header.bytes(size_of::<T>());
    if Some(map.len() - offset) != expected {
        let got = map.len() - offset;
        let expected = expected.map_or_else(|| "more".to_owned(), |bytes| bytes.to_string());
        let reason = format!(
            "expected {expected} bytes of data for shape ({rows}, {columns}), got {got}: the file is truncated or damaged"
        );
        return Err(FileError::npy(path, reason));
    }
    if !offset.is_multiple_of(align_of::<T>()) {
        let reason = "the data is not aligned; save it again with NumPy".to_owned();
        return Err(FileError::npy(path, reason));
    }
    // Before the map is moved: its bytes keep their address.
    Ok(MappedNpy { _known: Known::of(&map), map, offset, rows, columns, element: PhantomData })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_come_back() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("a.npy");
        write_npy(&path, &[1.0_f32, 2.0, 3.0, 4.0, 5.0, 6.0], 2, 3).expect("written");
        let mapped = map_npy::<f32>(&path).expect("readable");
        assert_eq!((mapped.rows(), mapped.columns()), (2, 3));
        assert_eq!(mapped.as_slice(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(std::fs::read(&path).expect("readable").len(), 128 + 24);
    }

    #[test]
    fn other_arrays_are_refused_with_the_reason() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("a.npy");
        write_npy(&path, &[1_u32, 2], 1, 2).expect("written");
        let kind = map_npy::<f32>(&path).expect_err("another type").to_string();
        assert!(kind.contains("'<f4'") && kind.contains("'<u4'"), "{kind}");
        let whole = std::fs::read(&path).expect("readable");
        std::fs::write(&path, &whole[..whole.len() - 3]).expect("written");
        let cut = map_npy::<u32>(&path).expect_err("truncated").to_string();
        assert!(cut.contains("truncated"), "{cut}");
        std::fs::write(&path, b"PAR1").expect("written");
        assert!(map_npy::<u32>(&path).is_err());
    }

    #[test]
    fn an_empty_array_is_an_array() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("a.npy");
        write_npy::<u32>(&path, &[], 0, 3).expect("written");
        assert_eq!(map_npy::<u32>(&path).expect("readable").rows(), 0);
    }
}
