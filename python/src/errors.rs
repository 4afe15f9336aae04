//! Converts errors of calib to exceptions with the same texts.

use calib_pipeline::{StepError, StudyError};
use calib_study::option_error;
use pyo3::{
    exceptions::{PyKeyboardInterrupt, PyTypeError, PyValueError},
    prelude::*,
    types::PyString,
};

/// Returns an exception of `calib_rl` by its name.
fn of_calib(py: Python<'_>, name: &str, text: &str) -> PyErr {
    made(py, name, text).unwrap_or_else(|error| error)
}

/// Creates the exception, or returns the error of its creation.
fn made(py: Python<'_>, name: &str, text: &str) -> PyResult<PyErr> {
    let class = py.import("calib_rl._errors")?.getattr(name)?;
    Ok(PyErr::from_value(class.call1((PyString::new(py, text),))?))
}

/// Converts the error of a step.
pub(crate) fn of_step(py: Python<'_>, error: &StepError) -> PyErr {
    if error.was_cancelled() {
        return PyKeyboardInterrupt::new_err(error.to_string());
    }
    let name = if error.place().is_some() { "StudyError" } else { "CalibError" };
    of_calib(py, name, &error.to_string())
}

/// Converts the error of a study.
pub(crate) fn of_study(py: Python<'_>, error: &StudyError) -> PyErr {
    of_calib(py, "StudyError", &error.to_string())
}

/// Returns the exception for a request that calib refuses, with this text.
pub(crate) fn of_text(py: Python<'_>, text: &str) -> PyErr {
    of_calib(py, "CalibError", text)
}

/// Converts any other error of calib.
pub(crate) fn of_any(py: Python<'_>, error: &dyn std::error::Error) -> PyErr {
    of_calib(py, "CalibError", &error.to_string())
}

/// Converts an error about an argument that cannot be used.
pub(crate) fn unusable(error: impl std::fmt::Display) -> PyErr {
    value(error.to_string())
}

/// Returns the exception for a wrong argument, with this text.
pub(crate) fn value(text: impl Into<String>) -> PyErr {
    PyValueError::new_err(text.into())
}

/// Converts an error about options that were given as keywords. An unknown one is a `TypeError`, as for any function.
pub(crate) fn of_options(error: &toml::de::Error) -> PyErr {
    let text = error.to_string();
    let is_unknown = text.starts_with("unknown field") && !text.contains("\nin `");
    let told = option_error(&text);
    if is_unknown { PyTypeError::new_err(told) } else { value(told) }
}
