use std::{io, path::Path};

use calib_core::Timestamp;
use calib_files::{FileError, write_atomically};
use pl::{IntoColumn as _, NewChunkedArray as _};
use polars::prelude as pl;

use super::{Cells, Table, Values};

impl Table {
    /// Writes the table as Parquet (zstd), atomically. The same table gives the same bytes for any
    /// number of threads.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_parquet(&self, path: &Path) -> Result<(), FileError> {
        let columns = self.columns.iter().map(|(name, values)| to_polars(name, values)).collect();
        let metadata =
            self.metadata.iter().map(|(key, value)| (key.clone(), value.clone())).collect();
        write_frame(path, self.rows(), columns, metadata)
    }
}

/// Writes columns as one Parquet file.
pub(crate) fn write_frame(
    path: &Path,
    rows: usize,
    columns: Vec<pl::Column>,
    metadata: Vec<(String, String)>,
) -> Result<(), FileError> {
    write_atomically(path, |file| {
        let mut frame = pl::DataFrame::new(rows, columns).map_err(io::Error::other)?;
        pl::ParquetWriter::new(file)
            .with_compression(pl::ParquetCompression::Zstd(None))
            .with_key_value_metadata(Some(pl::KeyValueMetadata::from_static(metadata)))
            .finish(&mut frame)
            .map_err(io::Error::other)?;
        Ok(())
    })
}

/// Returns a column of instants for polars: microseconds without a time zone.
pub(super) fn timestamps(
    name: &str,
    values: impl Iterator<Item = Option<Timestamp>>,
) -> pl::Column {
    let micros = values.map(|value| value.map(Timestamp::as_micros));
    pl::Int64Chunked::from_iter_options(name.into(), micros)
        .into_datetime(pl::TimeUnit::Microseconds, None)
        .into_column()
}

fn to_polars(name: &str, values: &Values) -> pl::Column {
    macro_rules! column {
        ($array:ty, $cells:expr) => {
            match $cells {
                Cells::Full(values) => <$array>::from_slice(name.into(), values).into_column(),
                Cells::Optional(values) => {
                    <$array>::from_slice_options(name.into(), values).into_column()
                }
            }
        };
    }
    match values {
        Values::Float64(cells) => column!(pl::Float64Chunked, cells),
        Values::Float32(cells) => column!(pl::Float32Chunked, cells),
        Values::UInt32(cells) => column!(pl::UInt32Chunked, cells),
        Values::UInt64(cells) => column!(pl::UInt64Chunked, cells),
        Values::Int64(cells) => column!(pl::Int64Chunked, cells),
        Values::Bool(cells) => column!(pl::BooleanChunked, cells),
        Values::Text(cells) => column!(pl::StringChunked, cells),
        Values::Time(Cells::Full(values)) => timestamps(name, values.iter().copied().map(Some)),
        Values::Time(Cells::Optional(values)) => timestamps(name, values.iter().copied()),
    }
}
