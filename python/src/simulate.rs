//! Simulates plants.

use std::path::PathBuf;

use calib_study::SimulateConfig;
use pyo3::{prelude::*, types::PyDict};

use crate::{convert, errors, work::run_step};

/// Writes the log of a simulated plant, one Parquet file per day. Returns a text about
/// what is there now.
#[pyfunction]
#[pyo3(signature = (directory, options, force=false, observer=None))]
pub(crate) fn simulate(
    py: Python<'_>,
    directory: PathBuf,
    options: &Bound<'_, PyDict>,
    force: bool,
    observer: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    let config: SimulateConfig = convert::options(options)?;
    let plant = config.plant().map_err(|error| errors::of_study(py, &error))?;
    let simulated = run_step(py, observer, |printer| {
        calib_pipeline::simulate_plant(&directory, plant, force, printer)
    })?;
    Ok(simulated.line())
}
