//! Writes tables of other libraries as logs.

use std::path::{Path, PathBuf};

use calib_data::write_arrow_stream;
use calib_files::FolderRecord;
use pyo3::{prelude::*, types::PyCapsule};

use crate::{
    errors,
    work::{Needs, watched},
};

/// The address of a stream, which can be sent to another thread.
struct Address(usize);

/// Writes the table of an `__arrow_c_stream__` capsule as Parquet. The path must be free, or hold a file that calib wrote. Returns
/// the numbers of rows and columns.
#[pyfunction]
pub(crate) fn write_log(
    py: Python<'_>,
    stream: &Bound<'_, PyCapsule>,
    path: PathBuf,
) -> PyResult<(usize, usize)> {
    let stream = Address(stream.pointer_checked(Some(c"arrow_array_stream"))?.as_ptr() as usize);
    let taken = watched(py, Needs::Tables, None, |_| {
        let Address(address) = stream;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        FolderRecord::open(path.parent().unwrap_or(Path::new("")))?.note([name])?;
        // SAFETY: a capsule of this name holds such a stream, which lives as long as the capsule. The caller keeps the
        // capsule until this call returns.
        unsafe { write_arrow_stream(address as *mut _, &path) }
    })?;
    let taken = taken.map_err(|error| errors::of_any(py, &error))?;
    Ok((taken.rows, taken.columns))
}
