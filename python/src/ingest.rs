//! Tables of other libraries as logs.

use std::path::PathBuf;

use calib_data::write_arrow_stream;
use pyo3::{prelude::*, types::PyCapsule};

use crate::{
    errors,
    work::{Needs, watched},
};

/// What another thread may be given of a stream: its address.
struct Address(usize);

/// Write the table that an `__arrow_c_stream__` capsule hands over as Parquet; its rows and columns.
#[pyfunction]
pub(crate) fn write_log(
    py: Python<'_>,
    stream: &Bound<'_, PyCapsule>,
    path: PathBuf,
) -> PyResult<(usize, usize)> {
    let stream = Address(stream.pointer_checked(Some(c"arrow_array_stream"))?.as_ptr() as usize);
    let work = |_: &_| {
        let Address(address) = stream;
        // SAFETY: a capsule of this name holds such a stream, which lives as long as the capsule; the caller waits for this.
        unsafe { write_arrow_stream(address as *mut _, &path) }
    };
    let taken = watched(py, Needs::Tables, None, work)?;
    let taken = taken.map_err(|error| errors::of_any(py, &error))?;
    Ok((taken.rows, taken.columns))
}
