use std::path::Path;

use calib_core::Timestamp;
use calib_files::FileError;
use pl::{IntoColumn as _, NewChunkedArray as _};
use polars::prelude as pl;

use super::write::{timestamps as to_polars, write_frame};

/// Writes a plant log as Parquet, atomically: column `timestamp` (microseconds, no time zone) and
/// one `f32` column per channel. NaN becomes a missing value.
///
/// # Errors
/// If the file cannot be written.
///
/// # Panics
/// If a channel does not have one value per timestamp, or two channels have the same name.
pub fn write_log<N: AsRef<str>>(
    path: &Path,
    timestamps: &[Timestamp],
    channels: &[(N, Vec<f32>)],
) -> Result<(), FileError> {
    let mut columns = vec![to_polars("timestamp", timestamps.iter().copied().map(Some))];
    for (name, values) in channels {
        let name = name.as_ref();
        assert_eq!(values.len(), timestamps.len(), "channel {name} needs a value per timestamp");
        assert!(
            columns.iter().all(|column| column.name() != name),
            "two columns are called {name}"
        );
        let array = if values.iter().any(|value| value.is_nan()) {
            let values = values.iter().map(|&value| (!value.is_nan()).then_some(value));
            pl::Float32Chunked::from_iter_options(name.into(), values)
        } else {
            pl::Float32Chunked::from_slice(name.into(), values)
        };
        columns.push(array.into_column());
    }
    write_frame(path, timestamps.len(), columns, Vec::new())
}
