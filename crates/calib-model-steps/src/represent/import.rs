//! Representations that are imported from files.

use std::{
    collections::HashMap,
    path::{Path, PathBuf},
};

use calib_base::{Context as _, StepError, bail, ensure, memory};
use calib_core::{States, StatesError, Timestamp};
use calib_data::{
    Dataset,
    table::{Table, parquet_names, read_parquet_columns, read_parquet_list},
};
use calib_files::{Fingerprint, read_array, read_json, read_tensors};
use calib_study::Job;
use serde::Deserialize;

/// Imported numbers by row.
struct ImportedRows {
    values: Vec<f32>,
    rows: usize,
    /// Times of the rows, if rows are joined by time.
    timestamps: Option<Vec<Timestamp>>,
    /// The data that they were made for, if the file names it.
    data: Option<String>,
}

/// The optional description beside an imported file: `psi.npy.json` beside `psi.npy`.
#[derive(Deserialize)]
struct Sidecar {
    /// `data` of the manifest of the model whose states were encoded.
    data: Fingerprint,
}

/// Returns the file that the study names, relative to the study's folder.
pub(super) fn file(job: &Job) -> Result<PathBuf, StepError> {
    let path = job.study().representation.path.as_deref();
    let path = path.context("[representation]: kind = \"import\" wants `path`, the file")?;
    Ok(job.beside(path))
}

/// Reads and checks ψ of every training state.
pub(super) fn read(job: &Job, dataset: &Dataset) -> Result<States, StepError> {
    let path = &file(job)?;
    let config = &job.study().representation;
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
    let found = match extension.as_deref() {
        Some("npy") => npy(path),
        Some("safetensors") => safetensors(path, config.tensor.as_deref()),
        Some("parquet" | "parq" | "pq") => {
            parquet(path, config.timestamp.as_deref(), &config.columns)
        }
        _ => bail!(
            "representation.path = \"{}\": expected a .npy, .safetensors or .parquet file",
            path.display()
        ),
    };
    let cannot = format!("representation.path: cannot import {}", path.display());
    let found = found.context(&cannot)?;
    check_origin(path, &found, dataset).context(&cannot)?;
    join(found, dataset).context(&cannot)
}

fn npy(path: &Path) -> Result<ImportedRows, StepError> {
    let array = read_array(path)?;
    let &[rows, _] = array.shape.as_slice() else {
        bail!("expected two dimensions, rows x dimensions of ψ, got the shape {:?}", array.shape);
    };
    let values = array.values.into_iter().map(|value| value as f32).collect();
    Ok(ImportedRows { values, rows, timestamps: None, data: None })
}

fn safetensors(path: &Path, name: Option<&str>) -> Result<ImportedRows, StepError> {
    let content = read_tensors(path)?;
    let names: Vec<&str> = content.tensors.iter().map(|tensor| tensor.name.as_str()).collect();
    let tensor = match (name, content.tensors.as_slice()) {
        (Some(name), _) => content.get(name).with_context(|| {
            format!("representation.tensor = \"{name}\": the file has {}", names.join(", "))
        })?,
        (None, [only]) => only,
        (None, _) => bail!(
            "the file has {} tensors ({}); name one with representation.tensor",
            names.len(),
            names.join(", ")
        ),
    };
    let &[rows, _] = tensor.shape.as_slice() else {
        bail!("expected two dimensions, rows x dimensions of ψ, got the shape {:?}", tensor.shape);
    };
    let data = content.metadata.get("data").cloned();
    Ok(ImportedRows { values: tensor.values.clone(), rows, timestamps: None, data })
}

fn parquet(
    path: &Path,
    timestamp: Option<&str>,
    columns: &[String],
) -> Result<ImportedRows, StepError> {
    let wanted: Vec<&str> = columns.iter().map(String::as_str).chain(timestamp).collect();
    memory::check_table(path, (!columns.is_empty()).then_some(wanted.as_slice()))?;
    let times = timestamp.map(|name| read_parquet_columns(path, &[name])).transpose()?;
    let timestamps = match (&times, timestamp) {
        (Some(table), Some(name)) => Some(table.column::<Timestamp>(name)?.to_vec()),
        _ => None,
    };
    let mut names = columns.to_vec();
    if names.is_empty() {
        names = parquet_names(path)?;
        names.retain(|name| Some(name.as_str()) != timestamp);
    }
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    if let [only] = names.as_slice()
        && let Some(lists) = read_parquet_list(path, only)?
    {
        return Ok(ImportedRows { values: lists.values, rows: lists.rows, timestamps, data: None });
    }
    let table = read_parquet_columns(path, &names)?;
    Ok(ImportedRows { values: interleaved(&table)?, rows: table.rows(), timestamps, data: None })
}

/// Returns the columns of a table as rows.
fn interleaved(table: &Table) -> Result<Vec<f32>, StepError> {
    let names: Vec<&str> = table.names().collect();
    let mut values = vec![0.0; table.rows() * names.len()];
    for (column, name) in names.iter().enumerate() {
        let numbers = table.numbers(name).context(
            "all columns but the timestamps hold ψ; name those that do with representation.columns, \
             and the timestamps with representation.timestamp",
        )?;
        for (row, number) in numbers.into_iter().enumerate() {
            values[row * names.len() + column] = number as f32;
        }
    }
    Ok(values)
}

/// Refuses a file that was made for other data, by its own description.
fn check_origin(path: &Path, found: &ImportedRows, dataset: &Dataset) -> Result<(), StepError> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".json");
    let beside = PathBuf::from(beside);
    let sidecar: Option<Sidecar> = if beside.exists() { Some(read_json(&beside)?) } else { None };
    let told = sidecar.map(|sidecar| sidecar.data.to_string()).or_else(|| found.data.clone());
    let expected = dataset.fingerprint.to_string();
    if let Some(told) = told.filter(|told| *told != expected) {
        bail!(
            "it was made for other data: its fingerprint is {told}, the study's data has {expected}"
        );
    }
    Ok(())
}

/// Returns one row of ψ for each training state.
fn join(found: ImportedRows, dataset: &Dataset) -> Result<States, StepError> {
    let ImportedRows { values, rows, timestamps, .. } = found;
    let expected = dataset.train.rows();
    let dimension = values.len().checked_div(rows).unwrap_or(0);
    ensure!(dimension > 0, "it holds no values");
    let Some(timestamps) = timestamps else {
        ensure!(
            rows == expected,
            "it has {rows} rows, the training range has {expected} states; \
             encode model/states.npy, or join by time with representation.timestamp"
        );
        return checked(values, rows, dimension);
    };
    ensure!(timestamps.len() == rows, "it has {} timestamps, {rows} rows", timestamps.len());
    let places: HashMap<Timestamp, usize> =
        timestamps.iter().enumerate().map(|(row, &time)| (time, row)).collect();
    ensure!(
        places.len() == rows,
        "{} of its timestamps occur more than once; expected one row a time",
        rows - places.len()
    );
    let mut joined = Vec::with_capacity(expected * dimension);
    for (row, time) in dataset.train.timestamps().iter().enumerate() {
        let place = *places.get(time).with_context(|| {
            format!("it has no row at {}, the time of state {row}", calib_data::format_time(*time))
        })?;
        joined.extend_from_slice(&values[place * dimension..][..dimension]);
    }
    checked(joined, expected, dimension)
}

fn checked(values: Vec<f32>, rows: usize, dimension: usize) -> Result<States, StepError> {
    // The squared distance Σ (x - y)² of two states of this size is still finite.
    let largest = (f32::MAX / (4.0 * dimension as f32)).sqrt();
    if let Some(place) = values.iter().position(|value| value.is_finite() && value.abs() > largest)
    {
        bail!(
            "ψ of state {} is {:e} in dimension {}, and distances between such states are infinite; scale it to at most {largest:.1e}",
            place / dimension,
            values[place],
            place % dimension
        );
    }
    States::new(values, rows, dimension).map_err(|error| match error {
        StatesError::NotFinite { row, column } => {
            StepError::message(format!("ψ of state {row} is not finite in dimension {column}"))
        }
        shape @ StatesError::Shape { .. } => shape.into(),
    })
}
