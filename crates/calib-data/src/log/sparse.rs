//! Channels with a value in few rows of the log. Only these rows are examined, so many such channels cost no more than
//! their samples.

use std::ops::Range;

use calib_core::Timestamp;

/// A channel with a value in fewer than one row in this many is stored by its rows.
const SPARSE: usize = 16;

/// The rows of a channel that have a value.
#[derive(Debug, Default)]
pub(crate) struct SparseValues {
    /// Rows with a value, in order.
    pub(crate) rows: Vec<u32>,
    pub(crate) values: Vec<f64>,
}

impl SparseValues {
    /// Returns the samples on rows of the log, if they are few.
    pub(crate) fn of(times: &[i64], values: &[f64], log: &[Timestamp]) -> Option<Self> {
        if times.len().saturating_mul(SPARSE) >= log.len() {
            return None;
        }
        let mut sparse = Self::default();
        for (&time, &value) in times.iter().zip(values).filter(|(_, value)| !value.is_nan()) {
            let row = log.partition_point(|row| row.as_micros() < time);
            sparse.rows.push(row as u32);
            sparse.values.push(value);
        }
        Some(sparse)
    }

    /// Returns one value for each of `rows` rows, NaN where there is no value.
    pub(crate) fn into_all(self, rows: usize) -> Vec<f64> {
        let mut all = vec![f64::NAN; rows];
        for (row, value) in self.rows.into_iter().zip(self.values) {
            all[row as usize] = value;
        }
        all
    }

    /// Returns how many of the rows lie in `range`.
    pub(crate) fn count(&self, range: &Range<usize>) -> usize {
        self.positions(range).len()
    }

    /// Returns the positions of the rows that lie in `range`.
    pub(crate) fn positions(&self, range: &Range<usize>) -> Range<usize> {
        let start = self.rows.partition_point(|&row| (row as usize) < range.start);
        let end = self.rows.partition_point(|&row| (row as usize) < range.end);
        start..end
    }

    /// Returns the rows with a value and their neighbours without one in the same of `stretches`. In the result, a run
    /// of missing values has at most two rows.
    pub(crate) fn with_neighbours(&self, stretches: &[Range<usize>]) -> Neighbourhood {
        let mut near = Neighbourhood::default();
        let mut place = 0;
        while place < self.rows.len() {
            let row = self.rows[place] as usize;
            let at = stretches.partition_point(|stretch| stretch.end <= row);
            let stretch = &stretches[at];
            let from = near.rows.len();
            while let Some(row) =
                self.rows.get(place).map(|&row| row as usize).filter(|row| *row < stretch.end)
            {
                if row > stretch.start {
                    near.add_missing(row - 1, from);
                }
                near.rows.push(row);
                near.values.push(self.values[place]);
                place += 1;
                let next = self.rows.get(place).map(|&next| next as usize);
                if row + 1 < stretch.end && next != Some(row + 1) {
                    near.add_missing(row + 1, from);
                }
            }
            near.stretches.push(from..near.rows.len());
        }
        near
    }
}

/// Some rows of the log, and the values of a channel there.
#[derive(Debug, Default)]
pub(crate) struct Neighbourhood {
    /// Rows, in order.
    pub(crate) rows: Vec<usize>,
    pub(crate) values: Vec<f64>,
    /// Rows of the same stretch, as ranges of positions in `rows`.
    pub(crate) stretches: Vec<Range<usize>>,
}

impl Neighbourhood {
    /// Returns the positions of the rows that lie in `range`.
    pub(crate) fn positions(&self, range: &Range<usize>) -> Range<usize> {
        let start = self.rows.partition_point(|row| *row < range.start);
        let end = self.rows.partition_point(|row| *row < range.end);
        start..end
    }

    /// Adds a row without a value, unless it exists; `from` is the first position of its stretch.
    fn add_missing(&mut self, row: usize, from: usize) {
        if self.rows.len() == from || self.rows.last().is_some_and(|last| *last < row) {
            self.rows.push(row);
            self.values.push(f64::NAN);
        }
    }
}
