//! Takes over a table in the memory of another program through Arrow's C stream interface, and writes it as Parquet.

use std::{ffi::c_void, path::Path};

use calib_files::FileError;
use pl::IntoColumn as _;
use polars::prelude as pl;
use polars_arrow::{
    array::{Array, StructArray},
    datatypes::{ArrowDataType, Field},
    ffi::{ArrowArrayStream, ArrowArrayStreamReader},
};

use crate::{catch_panic::catch_panic, table::write_frame};

/// The reason why a table of another program cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum ArrowError {
    /// The stream contains no table.
    #[error(
        "the data cannot be taken over: {0}; expected an Arrow table with a column of times and one column per channel"
    )]
    Stream(String),
    /// The table has no rows.
    #[error("the data has no rows")]
    NoRows,
    /// The file cannot be written.
    #[error(transparent)]
    File(#[from] FileError),
}

/// The size of the table that was taken over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TakenOver {
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub columns: usize,
}

/// Writes the table of an Arrow C stream as a Parquet file, with its columns unchanged.
///
/// The batches are not copied: memory holds the data of the producer and the pages that the writer compresses. The
/// stream is consumed.
///
/// # Errors
/// If the stream contains no table or one without rows, or if the file cannot be written.
///
/// # Safety
/// `stream` must point to an `ArrowArrayStream` that follows the [C stream
/// interface](https://arrow.apache.org/docs/format/CStreamInterface.html). Nothing else may read it meanwhile.
pub unsafe fn write_arrow_stream(
    stream: *mut c_void,
    path: &Path,
) -> Result<TakenOver, ArrowError> {
    // SAFETY: the caller guarantees such a stream. A released stream is left in its place, so it is released only once.
    let stream = unsafe { stream.cast::<ArrowArrayStream>().replace(ArrowArrayStream::empty()) };
    let (fields, batches) = catch_panic(|| {
        // SAFETY: as above.
        let mut reader = unsafe { ArrowArrayStreamReader::try_new(Box::new(stream)) }?;
        let fields = fields_of(reader.field())?;
        let mut batches: Vec<Vec<Box<dyn Array>>> = fields.iter().map(|_| Vec::new()).collect();
        // SAFETY: as above.
        while let Some(batch) = unsafe { reader.next() } {
            let batch = batch?;
            let Some(table) = batch.as_any().downcast_ref::<StructArray>() else {
                pl::polars_bail!(ComputeError: "a batch is no table");
            };
            for (column, values) in batches.iter_mut().zip(table.values()) {
                column.push(values.clone());
            }
        }
        Ok((fields, batches))
    })
    .map_err(ArrowError::Stream)?;
    let rows = batches.first().map_or(0, |columns| columns.iter().map(|chunk| chunk.len()).sum());
    if rows == 0 {
        return Err(ArrowError::NoRows);
    }
    let columns = fields
        .iter()
        .zip(batches)
        .map(|(field, chunks)| {
            catch_panic(|| Ok(pl::Series::try_from((field, chunks))?.into_column()))
                .map_err(|reason| ArrowError::Stream(format!("column {}: {reason}", field.name)))
        })
        .collect::<Result<Vec<_>, _>>()?;
    let taken = TakenOver { rows, columns: columns.len() };
    write_frame(path, rows, columns, Vec::new())?;
    Ok(taken)
}

fn fields_of(stream: &Field) -> pl::PolarsResult<Vec<Field>> {
    match stream.dtype() {
        ArrowDataType::Struct(fields) if !fields.is_empty() => Ok(fields.clone()),
        ArrowDataType::Struct(_) => pl::polars_bail!(ComputeError: "the table has no columns"),
        other => pl::polars_bail!(ComputeError: "it is a column of {other:?}, no table"),
    }
}

#[cfg(test)]
mod tests {
    use polars_arrow::{array::PrimitiveArray, ffi::export_iterator};

    use super::*;
    use crate::table::read_parquet_columns;

    fn stream(batches: Vec<Vec<i64>>) -> ArrowArrayStream {
        let field = Field::new("t".into(), ArrowDataType::Int64, false);
        let dtype = ArrowDataType::Struct(vec![field]);
        let dtype_of_batches = dtype.clone();
        let tables = batches.into_iter().map(move |values| {
            let rows = values.len();
            let column = PrimitiveArray::from_vec(values).boxed();
            Ok(StructArray::new(dtype_of_batches.clone(), rows, vec![column], None).boxed())
        });
        export_iterator(Box::new(tables), Field::new("".into(), dtype, false))
    }

    fn write(stream: &mut ArrowArrayStream, path: &Path) -> Result<TakenOver, ArrowError> {
        // SAFETY: polars made the stream.
        unsafe { write_arrow_stream(std::ptr::from_mut(stream).cast(), path) }
    }

    #[test]
    fn batches_become_one_file() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("log.parquet");
        let mut stream = stream(vec![vec![1, 2], vec![], vec![3]]);
        let taken = write(&mut stream, &path).expect("a table");
        assert_eq!(taken, TakenOver { rows: 3, columns: 1 });
        let read = read_parquet_columns(&path, &["t"]).expect("readable");
        assert_eq!(read.column::<i64>("t").expect("integers"), [1, 2, 3]);
        let again = write(&mut stream, &path).expect_err("used up");
        assert!(again.to_string().contains("released"), "{again}");
    }

    #[test]
    fn a_table_without_rows_is_refused() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("log.parquet");
        let refused = write(&mut stream(vec![vec![]]), &path).expect_err("nothing");
        assert!(matches!(refused, ArrowError::NoRows), "{refused}");
        assert!(!path.exists());
    }
}
