//! Normalised rows in files: states as a NumPy array, times and segments as a table.

use std::{path::Path, sync::Arc};

use calib_core::{Frames, Segments, States, Timestamp};
use calib_data::table::{Table, read_parquet_columns};
use calib_files::{map_npy, write_npy};

use crate::{Context as _, StepError};

/// Writes the states.
///
/// # Errors
/// If they cannot be written.
pub fn write_states(path: &Path, frames: &Frames) -> Result<(), StepError> {
    let states = frames.states();
    Ok(write_npy(path, states.as_slice(), states.rows(), states.columns())?)
}

/// Maps the states of a file, so that the system can free their memory when it is needed.
///
/// # Errors
/// If the file cannot be read, or is no array of states.
pub fn map_states(path: &Path) -> Result<States, StepError> {
    let mapped = map_npy::<f32>(path)?;
    let rows = mapped.rows();
    let columns = mapped.columns();
    Ok(States::from_shared(Arc::new(mapped), rows, columns)?)
}

/// Returns the table of rows: row → timestamp, segment.
pub fn rows_table(frames: &Frames) -> Table {
    let mut segments = Vec::with_capacity(frames.rows());
    for (number, segment) in frames.segments().iter().enumerate() {
        segments.extend(std::iter::repeat_n(number as u32, segment.len()));
    }
    Table::new().with("timestamp", frames.timestamps().to_vec()).with("segment", segments)
}

/// Reads a table of rows, and joins it with their `states`.
///
/// # Errors
/// If the table cannot be read, or does not have a row for each state.
pub fn open(path: &Path, states: States) -> Result<Frames, StepError> {
    let table = read_parquet_columns(path, &["timestamp", "segment"])?;
    let timestamps = table.column::<Timestamp>("timestamp")?.to_vec();
    let lengths = table.column::<u32>("segment")?.chunk_by(|a, b| a == b).map(<[u32]>::len);
    let segments = Segments::from_lengths(lengths)?;
    Frames::new(timestamps, segments, states)
        .with_context(|| format!("{} does not belong to its states", path.display()))
}
