//! What the files of a log declare before they are read.

use std::path::PathBuf;

use super::{
    head::Head,
    source::{find_files, without_empty},
};
use crate::{DataConfig, DataError};

/// Returns the files that `data` selects, in order of their names. They are not read. Some may turn out to be results
/// of calib, which are not logs.
///
/// # Errors
/// If a pattern selects nothing, or a folder cannot be read.
pub fn log_files(data: &DataConfig) -> Result<Vec<PathBuf>, DataError> {
    Ok(find_files(data)?.into_iter().map(|source| source.path).collect())
}

/// Size of a log according to its footers, before it is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Declared {
    /// Rows of all files; an estimate for text files, which do not declare it.
    pub rows: u64,
    /// Minimum memory for reading, in bytes, without the states.
    pub least_bytes: u64,
}

impl Declared {
    /// Reads the footers of the files that `data` names.
    ///
    /// # Errors
    /// If there are no files, or one cannot be read.
    pub fn of(data: &DataConfig) -> Result<Self, DataError> {
        let mut rows = 0_u64;
        for source in without_empty(find_files(data)?)?.0 {
            rows += match Head::open(source, data)? {
                Head::Parquet(file) if file.is_result => 0,
                Head::Parquet(file) => file.rows as u64,
                Head::Text(file) => file.estimated_rows(),
                Head::Annotated(..) => 0,
            };
        }
        Ok(Self { rows, least_bytes: rows.saturating_mul(BYTES_PER_ROW) })
    }
}

/// Per row: the timestamp as read and in order, and at least two channels that are read together, each as in the file
/// and as numbers.
const BYTES_PER_ROW: u64 = 8 + 8 + 2 * (8 + 8);
