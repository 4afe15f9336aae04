//! Errors of calib as exceptions, with the same texts.

use calib_pipeline::{StepError, StudyError};
use calib_study::option_error;
use pyo3::{
    exceptions::{PyKeyboardInterrupt, PyTypeError, PyValueError},
    prelude::*,
    types::PyString,
};

/// An exception of `calib_rl`, by its name.
fn of_calib(py: Python<'_>, name: &str, text: &str) -> PyErr {
    made(py, name, text).unwrap_or_else(|error| error)
}

/// The exception; what went wrong where it cannot be made.
fn made(py: Python<'_>, name: &str, text: &str) -> PyResult<PyErr> {
    let class = py.import("calib_rl._errors")?.getattr(name)?;
    Ok(PyErr::from_value(class.call1((PyString::new(py, text),))?))
}

/// What a step could not do.
pub(crate) fn of_step(py: Python<'_>, error: &StepError) -> PyErr {
    if error.was_cancelled() {
        return PyKeyboardInterrupt::new_err(error.to_string());
    }
    let name = if error.place().is_some() { "StudyError" } else { "CalibError" };
    of_calib(py, name, &error.to_string())
}

/// What is wrong with a study.
pub(crate) fn of_study(py: Python<'_>, error: &StudyError) -> PyErr {
    of_calib(py, "StudyError", &error.to_string())
}

/// What calib refuses, in these words.
pub(crate) fn of_text(py: Python<'_>, text: &str) -> PyErr {
    of_calib(py, "CalibError", text)
}

/// Anything else that calib refuses.
pub(crate) fn of_any(py: Python<'_>, error: &dyn std::error::Error) -> PyErr {
    of_calib(py, "CalibError", &error.to_string())
}

/// What a caller gave that cannot be used.
pub(crate) fn unusable(error: impl std::fmt::Display) -> PyErr {
    value(error.to_string())
}

/// What a caller got wrong.
pub(crate) fn value(text: impl Into<String>) -> PyErr {
    PyValueError::new_err(text.into())
}

/// What is wrong with options that were given as keywords. One that is unknown is a `TypeError`, as it is of any function.
pub(crate) fn of_options(error: &toml::de::Error) -> PyErr {
    let text = error.to_string();
    let is_unknown = text.starts_with("unknown field") && !text.contains("\nin `");
    let told = option_error(&text);
    if is_unknown { PyTypeError::new_err(told) } else { value(told) }
}
