use std::{path::Path, sync::Arc};

use calib_files::{HeldFile, open_regular};
use pl::ArrowDataType as D;
use pl::SerReader as _;
use polars::prelude as pl;

use super::TableError;
use crate::{
    catch_panic::catch_panic,
    checksums,
    log::{FieldKind, classify},
};

/// A column of lists of equal length.
#[derive(Clone, Debug, PartialEq)]
pub struct Lists {
    /// All values, row after row.
    pub values: Vec<f32>,
    /// Number of lists.
    pub rows: usize,
}

/// Returns the names of the columns of a Parquet file, in order.
///
/// # Errors
/// If the file cannot be read or is not Parquet.
pub fn parquet_names(path: &Path) -> Result<Vec<String>, TableError> {
    let mut reader = pl::ParquetReader::new(open_regular(path)?);
    catch_panic(|| Ok(reader.schema()?.iter_names().map(ToString::to_string).collect()))
        .map_err(|reason| TableError::not_parquet(path, reason))
}

/// Reads a column of lists of numbers; `None` if the column holds another type.
///
/// # Errors
/// If the file cannot be read, is not Parquet, has no such column, or its lists differ in length or have
/// missing values.
pub fn read_parquet_list(path: &Path, name: &str) -> Result<Option<Lists>, TableError> {
    let file = HeldFile::open(path)?;
    let mut reader = pl::ParquetReader::new(file.file()?);
    let schema =
        catch_panic(|| reader.schema()).map_err(|reason| TableError::not_parquet(path, reason))?;
    if !schema.contains(name) {
        let available = schema.iter_names().map(ToString::to_string).collect();
        return Err(TableError::NoColumn { name: name.to_owned(), available });
    }
    // Lists of other types than numbers make the reader panic, so they are rejected first.
    match schema.get(name).map(|field| &field.dtype) {
        Some(D::List(item) | D::LargeList(item) | D::FixedSizeList(item, _)) => {
            let (kind, got) = classify(&item.dtype);
            if kind != FieldKind::Number {
                let reason = format!("column {name}: expected lists of numbers, got {got}");
                return Err(TableError::not_parquet(path, reason));
            }
        }
        _ => return Ok(None),
    }
    let metadata = catch_panic(|| Ok(Arc::clone(reader.get_metadata()?)))
        .map_err(|reason| TableError::not_parquet(path, reason))?;
    checksums::verify(path, &file, &metadata, |column| column == name)?
        .map_err(|reason| TableError::not_parquet(path, reason))?;
    let frame = catch_panic(|| reader.with_columns(Some(vec![name.to_owned()])).finish())
        .map_err(|reason| TableError::not_parquet(path, reason))?;
    let column = catch_panic(|| Ok(frame.column(name)?.as_materialized_series().clone()))
        .map_err(|reason| TableError::not_parquet(path, reason))?;
    let Ok(lists) = column.list() else { return Ok(None) };
    let mut values = Vec::new();
    let mut width = None;
    for row in 0..lists.len() {
        let list = lists.get_as_series(row);
        let list = list.ok_or(TableError::MissingValue { name: name.to_owned(), row })?;
        let numbers = catch_panic(|| {
            let list = list.cast(&pl::DataType::Float32)?;
            Ok(list.f32()?.iter().collect::<Option<Vec<f32>>>())
        })
        .map_err(|reason| TableError::not_parquet(path, reason))?;
        let numbers = numbers.ok_or(TableError::MissingValue { name: name.to_owned(), row })?;
        let expected = *width.get_or_insert(numbers.len());
        if numbers.len() != expected {
            let reason = format!(
                "column {name}: expected lists of equal length, got {expected} and, in row {row}, {}",
                numbers.len()
            );
            return Err(TableError::not_parquet(path, reason));
        }
        values.extend(numbers);
    }
    Ok(Some(Lists { values, rows: lists.len() }))
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use pl::NamedFrom as _;

    use super::*;

    fn write(path: &Path, lists: &[&[f32]]) {
        let lists: pl::ListChunked =
            lists.iter().map(|values: &&[f32]| pl::Series::new("".into(), *values)).collect();
        let lists = lists.with_name("psi".into());
        let numbers = pl::Column::new("n".into(), vec![1.0; lists.len()]);
        let columns = vec![pl::IntoColumn::into_column(lists), numbers];
        let mut frame = pl::DataFrame::new_infer_height(columns).expect("a frame");
        let file = File::create(path).expect("writable");
        pl::ParquetWriter::new(file).finish(&mut frame).expect("written");
    }

    #[test]
    fn lists_of_equal_length_are_read() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("psi.parquet");
        write(&path, &[&[1.0, 2.0], &[3.0, 4.0], &[5.0, 6.0]]);
        assert_eq!(parquet_names(&path).expect("readable"), ["psi", "n"]);
        let lists = read_parquet_list(&path, "psi").expect("readable").expect("lists");
        assert_eq!(lists, Lists { values: vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0], rows: 3 });
        assert_eq!(read_parquet_list(&path, "n").expect("readable"), None);
        assert!(read_parquet_list(&path, "phi").is_err());
        write(&path, &[&[1.0, 2.0], &[3.0]]);
        let error = read_parquet_list(&path, "psi").expect_err("unequal").to_string();
        assert!(error.contains("in row 1, 1"), "{error}");
    }
}
