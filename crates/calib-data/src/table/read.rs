use std::{
    collections::{BTreeMap, HashSet},
    path::Path,
    sync::Arc,
};

use calib_core::Timestamp;
use calib_files::{HeldFile, open_regular};
use pl::SerReader as _;
use polars::prelude as pl;

use super::{Cells, Table, TableError, Values};
use crate::{
    catch_panic::catch_panic,
    checksums,
    log::{FieldKind, classify},
    statistics,
};

/// Key under which Parquet writers store their own description of the types; it is not shown.
const SCHEMA_KEY: &str = "ARROW:schema";

/// Reads a whole Parquet file.
///
/// Small integers become `i64` (signed) or `u32` (unsigned), dates and timestamps of any unit become [`Timestamp`]s,
/// and categories become text.
///
/// # Errors
/// If the file cannot be read, is not Parquet, or has a column of another type.
pub fn read_parquet(path: &Path) -> Result<Table, TableError> {
    read(path, None)
}

/// Reads some columns of a Parquet file, in the given order.
///
/// # Errors
/// As [`read_parquet`]; or if a column does not exist.
pub fn read_parquet_columns(path: &Path, names: &[&str]) -> Result<Table, TableError> {
    read(path, Some(names))
}

/// Maximum bytes per value that [`read_parquet`] needs, for numbers: in the reader, as cells, and as numbers.
const BYTES_PER_VALUE: u64 = 3 * 8 + 8;

/// Returns the memory that reading some columns needs, in bytes, according to the footer. `None` for `names` means all
/// columns. A small file may declare any number of values.
///
/// # Errors
/// If the file cannot be read or is not Parquet.
pub fn declared_bytes(path: &Path, names: Option<&[&str]>) -> Result<u64, TableError> {
    let mut reader = pl::ParquetReader::new(open_regular(path)?);
    let metadata = catch_panic(|| Ok(Arc::clone(reader.get_metadata()?)));
    let metadata = metadata.map_err(|reason| TableError::not_parquet(path, reason))?;
    let values = metadata.row_groups.iter().flat_map(|group| {
        let columns = group.parquet_columns().iter();
        let wanted = columns.filter(|column| {
            let name = column.descriptor().path_in_schema.first();
            name.is_some_and(|name| names.is_none_or(|names| names.contains(&name.as_str())))
        });
        wanted.map(|column| u64::try_from(column.num_values()).unwrap_or(0))
    });
    Ok(values.fold(0, u64::saturating_add).saturating_mul(BYTES_PER_VALUE))
}

fn read(path: &Path, names: Option<&[&str]>) -> Result<Table, TableError> {
    let file = HeldFile::open(path)?;
    let mut reader = pl::ParquetReader::new(file.file()?);
    let (metadata, schema) =
        catch_panic(|| Ok((Arc::clone(reader.get_metadata()?), reader.schema()?)))
            .map_err(|reason| TableError::not_parquet(path, reason))?;
    let texts = metadata
        .key_value_metadata
        .iter()
        .flatten()
        .filter(|pair| pair.key != SCHEMA_KEY)
        .map(|pair| (pair.key.clone(), pair.value.clone().unwrap_or_default()))
        .collect::<BTreeMap<_, _>>();
    let names: Vec<String> = match names {
        Some(names) => names.iter().map(|&name| name.to_owned()).collect(),
        None => schema.iter_names().map(ToString::to_string).collect(),
    };
    if let Some(name) = names.iter().find(|name| !schema.contains(name.as_str())) {
        let available = schema.iter_names().map(ToString::to_string).collect();
        return Err(TableError::NoColumn { name: name.clone(), available });
    }
    // Some types make the reader panic, so they are rejected first.
    let of_other_type = names.iter().find_map(|name| {
        let (kind, got) = classify(&schema.get(name)?.dtype);
        (kind == FieldKind::Other).then(|| (name.clone(), got))
    });
    if let Some((name, got)) = of_other_type {
        return Err(TableError::UnknownType { path: path.to_owned(), name, got });
    }
    let wanted: HashSet<&str> = names.iter().map(String::as_str).collect();
    checksums::verify(path, &file, &metadata, |column| wanted.contains(column))?
        .map_err(|reason| TableError::not_parquet(path, reason))?;
    let frame = catch_panic(|| reader.with_columns(Some(names.clone())).finish())
        .map_err(|reason| TableError::not_parquet(path, reason))?;
    let mut read = Vec::with_capacity(names.len());
    for name in &names {
        let column = catch_panic(|| frame.column(name).cloned())
            .map_err(|reason| TableError::not_parquet(path, reason))?;
        statistics::verify(&metadata, name, &(0..frame.height()), &column)
            .map_err(|reason| TableError::not_parquet(path, reason))?;
        let values = catch_panic(|| from_polars(&column))
            .map_err(|reason| TableError::not_parquet(path, reason))?;
        read.push((values, column.dtype().to_string()));
    }
    let columns = names.into_iter().zip(read).map(|(name, (values, got))| match values {
        Some(values) => Ok((name, values)),
        None => Err(TableError::UnknownType { path: path.to_owned(), name, got }),
    });
    Ok(Table { columns: columns.collect::<Result<_, _>>()?, metadata: texts })
}

fn from_polars(column: &pl::Column) -> pl::PolarsResult<Option<Values>> {
    use pl::DataType as D;
    let missing = column.null_count();
    macro_rules! cells {
        ($dtype:expr, $array:ident, $variant:ident) => {{
            let column = column.cast($dtype)?;
            Values::$variant(Cells::collect(column.$array()?.iter(), missing))
        }};
    }
    Ok(Some(match column.dtype() {
        D::Float64 | D::Decimal(..) => cells!(&D::Float64, f64, Float64),
        D::Float32 => cells!(&D::Float32, f32, Float32),
        D::UInt8 | D::UInt16 | D::UInt32 => cells!(&D::UInt32, u32, UInt32),
        D::UInt64 => cells!(&D::UInt64, u64, UInt64),
        D::Int8 | D::Int16 | D::Int32 | D::Int64 => cells!(&D::Int64, i64, Int64),
        D::Boolean => cells!(&D::Boolean, bool, Bool),
        D::String | D::Categorical(..) | D::Enum(..) => {
            let column = column.cast(&D::String)?;
            let text = column.str()?.iter().map(|text| text.map(str::to_owned));
            Values::Text(Cells::collect(text, missing))
        }
        D::Date | D::Datetime(..) => {
            let micros = column.cast(&D::Datetime(pl::TimeUnit::Microseconds, None))?;
            let micros = micros.datetime()?.physical();
            let instants = micros.iter().map(|micros| micros.map(Timestamp::from_micros));
            Values::Time(Cells::collect(instants, missing))
        }
        _ => return Ok(None),
    }))
}
