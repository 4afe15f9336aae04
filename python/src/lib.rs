//! calib as a Python module: `calib_rl._calib`. The interface for users is in `python/calib_rl`, with its documentation.
//!
//! Arrays go through NumPy's array interface (`array`). Arrays from Python are copied once. Python owns returned arrays, or
//! they are views of a mapped file. Long work has a thread of its own, while the calling thread checks for Ctrl-C (`work`).

#![expect(
    clippy::needless_pass_by_value,
    reason = "pyo3 hands over what it made of Python's values"
)]

mod acting;
mod acting_rollouts;
mod array;
mod control_agent;
mod convert;
mod dtw;
mod errors;
mod ingest;
mod join;
mod lost;
mod model;
mod observer;
mod rollouts;
mod shared_action_model;
mod shared_model;
mod simulate;
mod streams;
mod study;
mod tuned_page;
mod work;

use pyo3::prelude::*;

/// Runs the command line, for the command in the wheel. Returns its exit code.
#[pyfunction]
fn main(py: Python<'_>, arguments: Vec<String>) -> u8 {
    py.detach(|| calib::exit_code(arguments.into_iter().map(Into::into)))
}

#[pymodule]
fn _calib(module: &Bound<'_, PyModule>) -> PyResult<()> {
    hush_readers();
    lost::watch();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<study::PyJob>()?;
    module.add_class::<model::Model>()?;
    module.add_class::<rollouts::PyRollouts>()?;
    module.add_class::<acting::PyActionModel>()?;
    module.add_class::<acting_rollouts::PyActionRollouts>()?;
    module.add_class::<control_agent::ControlAgent>()?;
    module.add_class::<streams::Streams>()?;
    module.add_class::<streams::Score>()?;
    module.add_function(wrap_pyfunction!(convert::to_toml, module)?)?;
    module.add_function(wrap_pyfunction!(convert::to_toml_value, module)?)?;
    module.add_function(wrap_pyfunction!(array::require_memory_of, module)?)?;
    module.add_function(wrap_pyfunction!(dtw::dtw, module)?)?;
    module.add_function(wrap_pyfunction!(ingest::write_log, module)?)?;
    module.add_function(wrap_pyfunction!(streams::evaluate_runs, module)?)?;
    module.add_function(wrap_pyfunction!(join::knn_join, module)?)?;
    module.add_function(wrap_pyfunction!(simulate::simulate, module)?)?;
    module.add_function(wrap_pyfunction!(tuned_page::write_tuned_page, module)?)?;
    module.add_function(wrap_pyfunction!(work::set_threads, module)?)?;
    module.add_function(wrap_pyfunction!(main, module)?)
}

/// Silences panics of the Parquet reader on damaged files, which are reported as errors of the file.
fn hush_readers() {
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        if !calib_data::is_reading_parquet() {
            usual(panic);
        }
    }));
}
