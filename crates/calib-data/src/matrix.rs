//! The states of one range, while they are filled column by column.

use std::{path::PathBuf, sync::Arc};

use calib_core::{Bounds, Column, Frames, FramesError, Physical, States, StatesError, Timestamp};
use calib_files::{Scratch, ScratchFile, ScratchPlace};
use calib_text::format_time;
use rayon::prelude::*;

use crate::{DataError, sample::Samples, survey::RangeSamples};

/// Number of rows of the states that one task fills.
const BLOCK_ROWS: usize = 256;

/// The states of one range, stored row by row in memory. In a file they are stored column by column until all are
/// known: otherwise each batch of channels would touch every page of the rows.
pub(crate) struct Matrix<'a> {
    part: &'a RangeSamples,
    values: Values,
    width: usize,
}

enum Values {
    /// In memory, row by row.
    Rows(Scratch<f32>),
    /// In a file, column by column.
    Columns(ScratchFile<f32>, PathBuf),
}

impl<'a> Matrix<'a> {
    pub(crate) fn new(
        part: &'a RangeSamples,
        width: usize,
        place: &ScratchPlace,
    ) -> Result<Self, DataError> {
        let len = part.samples.rows() * width;
        let values = match place {
            ScratchPlace::Memory => Values::Rows(Scratch::zeroed(len, place)?),
            ScratchPlace::Disk(directory) => {
                Values::Columns(ScratchFile::new(len, directory)?, directory.clone())
            }
        };
        Ok(Self { part, values, width })
    }

    /// Fills the columns from `first` on with the sampled, normalised values of `columns`.
    pub(crate) fn fill(
        &mut self,
        first: usize,
        columns: &[(&[f64], Bounds)],
    ) -> Result<(), DataError> {
        let (samples, width): (&Samples, usize) = (&self.part.samples, self.width);
        match &mut self.values {
            Values::Rows(states) => fill_rows(states, samples, width, first, columns),
            Values::Columns(file, _) => {
                let rows = samples.rows();
                let mut filled = vec![0.0; rows];
                for (column, &(values, bounds)) in (first..).zip(columns) {
                    filled.par_iter_mut().enumerate().for_each(|(row, state)| {
                        *state = bounds.normalise(Physical(samples.value(values, row))).0;
                    });
                    file.write(column * rows, &filled)?;
                }
            }
        }
        Ok(())
    }

    /// Returns the frames; all columns must be filled.
    pub(crate) fn into_frames(
        self,
        log: &[Timestamp],
        columns: &[Column],
    ) -> Result<Frames, DataError> {
        let samples = &self.part.samples;
        let rows = samples.rows();
        let width = self.width;
        let values = match self.values {
            Values::Rows(states) => states,
            Values::Columns(file, directory) => by_rows(&file, rows, width, directory)?,
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

fn fill_rows(
    states: &mut [f32],
    samples: &Samples,
    width: usize,
    first: usize,
    columns: &[(&[f64], Bounds)],
) {
    states.par_chunks_mut(width * BLOCK_ROWS).enumerate().for_each(|(block, rows)| {
        // Column by column: reads are contiguous, and writes stay in the cache.
        for (column, &(values, bounds)) in (first..).zip(columns) {
            for (row, state) in rows.chunks_exact_mut(width).enumerate() {
                let physical = samples.value(values, block * BLOCK_ROWS + row);
                state[column] = bounds.normalise(Physical(physical)).0;
            }
        }
    });
}

/// Transposes the values to rows. Strips of rows are written one after the other; each reads a piece of every column.
fn by_rows(
    columns: &ScratchFile<f32>,
    rows: usize,
    width: usize,
    directory: PathBuf,
) -> Result<Scratch<f32>, DataError> {
    /// Number of values of a strip, so that pieces of columns are some thousand values long.
    const STRIP: usize = 1 << 22;
    let mut states = Scratch::zeroed(rows * width, &ScratchPlace::Disk(directory))?;
    let strip_rows = (STRIP / width.max(1)).clamp(1, rows.max(1));
    let mut strip = vec![0.0; strip_rows * width];
    for (number, filled) in states.chunks_mut((strip_rows * width).max(1)).enumerate() {
        let first = number * strip_rows;
        let len = filled.len() / width;
        let pieces = strip.par_chunks_mut(strip_rows).enumerate();
        pieces.try_for_each(|(column, piece)| {
            columns.read(column * rows + first, &mut piece[..len])
        })?;
        filled.par_chunks_mut(width * BLOCK_ROWS).enumerate().for_each(|(block, part)| {
            for column in 0..width {
                let values = &strip[column * strip_rows + block * BLOCK_ROWS..];
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
            let file = ScratchFile::new(columns.len(), disk.path()).expect("room");
            file.write(0, &columns).expect("room");
            let states = by_rows(&file, rows, width, disk.path().to_owned()).expect("room");
            for row in 0..rows {
                for column in 0..width {
                    prop_assert_eq!(states[row * width + column], columns[column * rows + row]);
                }
            }
        }
    }
}
