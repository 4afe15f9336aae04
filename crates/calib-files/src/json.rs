use std::{io, path::Path};

use serde::{Serialize, de::DeserializeOwned};

use crate::{FileError, read_regular, write_atomically};

/// Reads a JSON file.
///
/// # Errors
/// If it cannot be read or does not have the form of `T`.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, FileError> {
    let bytes = read_regular(path)?;
    serde_json::from_slice(&bytes)
        .map_err(|source| FileError::Json { path: path.to_owned(), source })
}

/// Writes `value` as indented JSON with a final newline,
/// atomically.
///
/// # Errors
/// If the file cannot be written.
pub fn write_json<T: Serialize>(path: &Path, value: &T) -> Result<(), FileError> {
    write_atomically(path, |file| {
        serde_json::to_writer_pretty(&mut *file, value).map_err(io::Error::from)?;
        io::Write::write_all(file, b"\n")
    })
}
