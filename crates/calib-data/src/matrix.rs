//! The states of one range, while they are filled column by column.

use std::sync::Arc;

use calib_core::{Bounds, Column, Frames, FramesError, Physical, States, StatesError, Timestamp};
use calib_files::{Scratch, ScratchPlace};
use rayon::prelude::*;

use crate::{DataError, sample::Samples, survey::Part, time::format_time};

/// Rows of the states that one task fills.
const BLOCK_ROWS: usize = 256;

/// The states of one range, row by row in memory. In a file they lie column by column until all are known: columns that
/// are written one after the other would touch each page of the rows once for each batch of channels.
pub(crate) struct Matrix<'a> {
    part: &'a Part,
    place: ScratchPlace,
    values: Scratch<f32>,
    width: usize,
}

impl<'a> Matrix<'a> {
    pub(crate) fn new(
        part: &'a Part,
        width: usize,
        place: &ScratchPlace,
    ) -> Result<Self, DataError> {
        let values = Scratch::zeroed(part.samples.rows() * width, place)?;
        Ok(Self { part, place: place.clone(), values, width })
    }

    fn is_by_columns(&self) -> bool {
        self.place != ScratchPlace::Memory
    }

    /// Fill the columns from `first` on with the sampled, normalised values of `columns`.
    pub(crate) fn fill(&mut self, first: usize, columns: &[(&[f64], Bounds)]) {
        let (samples, width): (&Samples, usize) = (&self.part.samples, self.width);
        let rows = samples.rows();
        if rows == 0 {
            return;
        }
        if self.is_by_columns() {
            let filled = &mut self.values[first * rows..][..columns.len() * rows];
            for (column, &(values, bounds)) in filled.chunks_exact_mut(rows).zip(columns) {
                column.par_iter_mut().enumerate().for_each(|(row, state)| {
                    *state = bounds.normalise(Physical(samples.value(values, row))).0;
                });
            }
            return;
        }
        self.values.par_chunks_mut(width * BLOCK_ROWS).enumerate().for_each(|(block, rows)| {
            // Column by column: reads are contiguous, writes stay in the cache.
            for (column, &(values, bounds)) in (first..).zip(columns) {
                for (row, state) in rows.chunks_exact_mut(width).enumerate() {
                    let physical = samples.value(values, block * BLOCK_ROWS + row);
                    state[column] = bounds.normalise(Physical(physical)).0;
                }
            }
        });
    }

    /// All columns are filled.
    pub(crate) fn into_frames(
        self,
        log: &[Timestamp],
        columns: &[Column],
    ) -> Result<Frames, DataError> {
        let samples = &self.part.samples;
        let (rows, width) = (samples.rows(), self.width);
        let values = if self.is_by_columns() {
            by_rows(&self.values, rows, width, &self.place)?
        } else {
            self.values
        };
        let timestamps = samples.timestamps(log);
        let states =
            States::from_shared(Arc::new(values), rows, width).map_err(|error| match error {
                StatesError::NotFinite { row, column } => DataError::NotFinite {
                    column: columns[column].name.clone(),
                    at: format_time(timestamps[row]),
                },
                StatesError::Shape { .. } => unreachable!("the matrix has rows x columns values"),
            })?;
        match Frames::new(timestamps, samples.segments.clone(), states) {
            Ok(frames) => Ok(frames),
            Err(FramesError::Rows { .. } | FramesError::Order { .. }) => {
                unreachable!("rows of the log are in time order, each instant once")
            }
        }
    }
}

/// The same values row by row. Strips of rows are written one after the other; each reads a piece of every column.
fn by_rows(
    columns: &[f32],
    rows: usize,
    width: usize,
    place: &ScratchPlace,
) -> Result<Scratch<f32>, DataError> {
    /// Values of a strip: what a few megabytes hold, so that pieces of columns are some thousand values long.
    const STRIP: usize = 1 << 22;
    let mut states = Scratch::zeroed(rows * width, place)?;
    let strip_rows = (STRIP / width.max(1)).clamp(1, rows.max(1));
    for (strip, filled) in states.chunks_mut((strip_rows * width).max(1)).enumerate() {
        let first = strip * strip_rows;
        filled.par_chunks_mut(width * BLOCK_ROWS).enumerate().for_each(|(block, part)| {
            let start = first + block * BLOCK_ROWS;
            for column in 0..width {
                let values = &columns[column * rows + start..];
                for (state, &value) in part.chunks_exact_mut(width).zip(values) {
                    state[column] = value;
                }
            }
        });
    }
    Ok(states)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn columns_become_rows(rows in 0_usize..2000, width in 1_usize..40) {
            let columns: Vec<f32> = (0..rows * width).map(|at| at as f32).collect();
            let disk = tempfile::tempdir().expect("a directory");
            let place = ScratchPlace::Disk(disk.path().to_owned());
            let states = by_rows(&columns, rows, width, &place).expect("room");
            for row in 0..rows {
                for column in 0..width {
                    prop_assert_eq!(states[row * width + column], columns[column * rows + row]);
                }
            }
        }
    }
}
