//! Keeps cells of text files outside of memory, column by column.

use std::{ops::Range, sync::Arc};

use calib_files::{FileError, Spill};

use super::{bad_rows_found::BadRowsFound, memory_limit::MemoryLimit};
use crate::{
    DataConfig, DataError,
    text::{Signs, Words},
};

/// Storage of the cells of text files, with the words in them.
#[derive(Debug)]
pub(crate) struct Store {
    pub(crate) spill: Spill,
    pub(crate) words: Words,
    pub(crate) signs: Signs,
    pub(crate) memory: MemoryLimit,
    pub(crate) bad_rows: BadRowsFound,
}

/// Findings in cells, in addition to their values.
#[derive(Debug, Default)]
pub(crate) struct Seen {
    pub(crate) words: Words,
    /// Evidence about the decimal sign beyond that of the first rows.
    pub(super) signs: Signs,
    pub(crate) bad_rows: BadRowsFound,
}

impl Store {
    pub(crate) fn new(data: &DataConfig) -> Result<Self, DataError> {
        Ok(Self {
            spill: Spill::new(&data.scratch)?,
            words: Words::bounded(),
            signs: Signs::default(),
            memory: MemoryLimit::of(data),
            bad_rows: BadRowsFound::default(),
        })
    }

    /// Translates `cells`, which were read with `seen`, to cells of this store.
    ///
    /// # Errors
    /// If two cells of the log have different decimal signs.
    pub(crate) fn adopt(&mut self, seen: Seen, cells: &mut [u64]) -> Result<(), DataError> {
        self.words.adopt(&seen.words, cells);
        self.bad_rows.adopt(seen.bad_rows);
        self.signs.adopt(seen.signs);
        Ok(self.signs.refuse_contradiction()?)
    }

    /// Reads the cells that were appended at `at`.
    pub(crate) fn read(&self, at: u64, count: usize) -> Result<Vec<u64>, FileError> {
        let mut cells = vec![0_u64; count];
        self.spill.read(at, bytemuck::cast_slice_mut(&mut cells))?;
        Ok(cells)
    }

    pub(crate) fn append(&mut self, cells: &[u64]) -> Result<u64, FileError> {
        self.spill.append(bytemuck::cast_slice(cells))
    }
}

/// The location of the columns of a file in a [`Store`].
#[derive(Debug, Default)]
pub(crate) struct Columns {
    /// First row, number of rows, and position of the first column; the other columns follow it.
    parts: Vec<(usize, usize, u64)>,
    pub(crate) rows: usize,
}

impl Columns {
    /// Adds `rows` rows, whose columns begin at `at` in the store.
    pub(super) fn add(&mut self, rows: usize, at: u64) {
        self.parts.push((self.rows, rows, at));
        self.rows += rows;
    }

    /// Reads the cells of a column in `rows`.
    pub(crate) fn read(
        &self,
        column: usize,
        rows: &Range<usize>,
        store: &Store,
    ) -> Result<Vec<u64>, FileError> {
        let mut cells = Vec::with_capacity(rows.len());
        let first = self.parts.partition_point(|(start, count, _)| start + count <= rows.start);
        for &(start, count, at) in &self.parts[first..] {
            let inside = start.max(rows.start)..(start + count).min(rows.end);
            if inside.is_empty() {
                break;
            }
            let skipped = column * count + inside.start - start;
            cells.extend(store.read(at + (skipped * size_of::<u64>()) as u64, inside.len())?);
        }
        Ok(cells)
    }
}

/// The content of a file of columns.
#[derive(Debug)]
pub(crate) struct Stored {
    pub(crate) columns: Columns,
    /// Instants of the rows, [`NO_TIME`](super::rows::NO_TIME) for a missing time.
    pub(crate) times: Vec<i64>,
    pub(crate) store: Arc<Store>,
}
