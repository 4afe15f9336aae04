use std::path::{Path, PathBuf};

use calib_files::FileError;

use super::Values;

/// The reason why a table cannot be read, written or used as expected.
#[derive(Debug, thiserror::Error)]
pub enum TableError {
    /// The file cannot be opened or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The file is not Parquet, or is damaged.
    #[error("{} is not a readable Parquet file: {reason}", path.display())]
    NotParquet {
        /// The file.
        path: PathBuf,
        /// Finding of the reader.
        reason: String,
    },
    /// A column has an unsupported type.
    #[error(
        "column {name} of {} is of type {got}; expected numbers, booleans, text or timestamps",
        path.display()
    )]
    UnknownType {
        /// The file.
        path: PathBuf,
        /// The column.
        name: String,
        /// Its type.
        got: String,
    },
    /// The requested column does not exist.
    #[error("there is no column {name}; the columns are: {}", available.join(", "))]
    NoColumn {
        /// The requested column.
        name: String,
        /// The existing columns.
        available: Vec<String>,
    },
    /// The column has another type.
    #[error("column {name} holds {got}, expected {expected}")]
    WrongType {
        /// The column.
        name: String,
        /// The requested type.
        expected: &'static str,
        /// The actual type.
        got: &'static str,
    },
    /// A value is missing where none should be.
    #[error("column {name} has no value in row {row}")]
    MissingValue {
        /// The column.
        name: String,
        /// First row without a value.
        row: usize,
    },
}

impl TableError {
    pub(super) fn not_parquet(path: &Path, reason: String) -> Self {
        Self::NotParquet { path: path.to_owned(), reason }
    }

    pub(super) fn wrong_type(name: &str, expected: &'static str, got: &Values) -> Self {
        Self::WrongType { name: name.to_owned(), expected, got: got.type_name() }
    }
}
