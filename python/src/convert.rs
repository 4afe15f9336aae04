//! Converts dictionaries of Python to values of TOML.

use pyo3::{
    exceptions::PyTypeError,
    prelude::*,
    types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple},
};
use serde::de::DeserializeOwned;
use toml::{Table, Value};

/// Converts keywords to options.
///
/// # Errors
/// `TypeError` for an unknown keyword or a value that TOML cannot represent, `ValueError` for a wrong value.
pub(crate) fn options<T: DeserializeOwned>(keywords: &Bound<'_, PyDict>) -> PyResult<T> {
    table(keywords.as_any(), "", DEEPEST)?
        .try_into()
        .map_err(|error| crate::errors::of_options(&error))
}

/// The deepest nesting of dictionaries and lists. Deeper nesting is not a study, and a structure that contains itself has no
/// end.
const DEEPEST: usize = 32;

/// Converts a dictionary to a table of TOML, with `left` more levels of nesting allowed. `above` is its key, or empty. A key with the value
/// `None` is left out.
///
/// # Errors
/// `TypeError` with the key, for a value that TOML cannot represent.
fn table(object: &Bound<'_, PyAny>, above: &str, left: usize) -> PyResult<Table> {
    let left = deeper(above, left)?;
    let mut table = Table::new();
    let items = object.call_method0("items").map_err(|_| not_toml(object, above))?;
    for item in items.try_iter()? {
        let (key, value): (Bound<'_, PyAny>, Bound<'_, PyAny>) = item?.extract()?;
        let key: String = key.str()?.extract()?;
        let path = if above.is_empty() { key.clone() } else { format!("{above}.{key}") };
        if !value.is_none() {
            table.insert(key, self::value(&value, &path, left)?);
        }
    }
    Ok(table)
}

/// Returns the levels of nesting that remain one level deeper.
fn deeper(path: &str, left: usize) -> PyResult<usize> {
    left.checked_sub(1).ok_or_else(|| {
        let shown: String = path.chars().take(60).collect();
        crate::errors::value(format!(
            "{shown}… is nested more than {DEEPEST} deep, or holds itself; a study has sections, keys and lists"
        ))
    })
}

fn value(object: &Bound<'_, PyAny>, path: &str, left: usize) -> PyResult<Value> {
    if object.is_instance_of::<PyBool>() {
        return Ok(Value::Boolean(object.extract()?));
    }
    if object.is_instance_of::<PyInt>() {
        return Ok(Value::Integer(object.extract()?));
    }
    if object.is_instance_of::<PyFloat>() {
        return Ok(Value::Float(object.extract()?));
    }
    if object.is_instance_of::<PyString>() {
        return Ok(Value::String(object.extract()?));
    }
    if object.is_instance_of::<PyDict>() {
        return Ok(Value::Table(table(object, path, left)?));
    }
    if object.is_instance_of::<PyList>() || object.is_instance_of::<PyTuple>() {
        let left = deeper(path, left)?;
        let values = object.try_iter()?.enumerate();
        return Ok(Value::Array(
            values
                .map(|(at, item): (usize, PyResult<Bound<'_, PyAny>>)| {
                    value(&item?, &format!("{path}[{at}]"), left)
                })
                .collect::<PyResult<_>>()?,
        ));
    }
    // These are dates and times, paths, and the numbers and arrays of NumPy.
    if object.hasattr("isoformat")? {
        let text: String = object.call_method0("isoformat")?.extract()?;
        return text.parse().map(Value::Datetime).map_err(|_| not_toml(object, path));
    }
    if object.hasattr("__fspath__")? {
        return Ok(Value::String(object.call_method0("__fspath__")?.extract()?));
    }
    if object.hasattr("tolist")? {
        return value(&object.call_method0("tolist")?, path, deeper(path, left)?);
    }
    Err(not_toml(object, path))
}

fn not_toml(object: &Bound<'_, PyAny>, path: &str) -> PyErr {
    let kind = object.get_type().name().map_or_else(|_| "?".to_owned(), |name| name.to_string());
    let place = if path.is_empty() { "a study".to_owned() } else { path.to_owned() };
    PyTypeError::new_err(format!(
        "{place} is a {kind}; expected a number, text, a truth value, a date, a path, or a list or dictionary of them"
    ))
}

/// Formats a Python value for `key` as a value of TOML on one line.
#[pyfunction]
pub(crate) fn to_toml_value(object: &Bound<'_, PyAny>, key: &str) -> PyResult<String> {
    Ok(value(object, key, DEEPEST)?.to_string())
}

/// Formats a dictionary as the text of a study file.
#[pyfunction]
pub(crate) fn to_toml(object: &Bound<'_, PyAny>) -> PyResult<String> {
    toml::to_string(&table(object, "", DEEPEST)?).map_err(crate::errors::unusable)
}
