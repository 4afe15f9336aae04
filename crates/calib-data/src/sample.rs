//! Sub-sampling: maps rows of the states to rows of the log.

use std::ops::Range;

use calib_core::{SegmentError, Segments, Timestamp};

use crate::Reduce;

/// The rows of the states of one range. Row i stands for `width` rows of the log from `starts[i]`
/// on.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Samples {
    pub(crate) starts: Vec<u32>,
    /// 1 if rows are kept unchanged; otherwise the number of rows that are averaged.
    pub(crate) width: usize,
    pub(crate) segments: Segments,
}

impl Samples {
    /// Takes one row in `every` of each of `runs`, counted from the first row of the run.
    pub(crate) fn of(
        runs: &[Range<usize>],
        every: usize,
        reduce: Reduce,
    ) -> Result<Self, SegmentError> {
        let mut starts = Vec::with_capacity(runs.iter().map(|run| run.len() / every + 1).sum());
        let mut lengths = Vec::with_capacity(runs.len());
        for run in runs {
            let count = match reduce {
                Reduce::Keep => run.len().div_ceil(every),
                Reduce::Mean => run.len() / every,
            };
            if count > 0 {
                starts.extend((0..count).map(|sample| (run.start + sample * every) as u32));
                lengths.push(count);
            }
        }
        Ok(Self {
            starts,
            width: match reduce {
                Reduce::Keep => 1,
                Reduce::Mean => every,
            },
            segments: Segments::from_lengths(lengths)?,
        })
    }

    pub(crate) fn rows(&self) -> usize {
        self.starts.len()
    }

    /// Returns the number of pairs of successive rows inside segments.
    pub(crate) fn transitions(&self) -> usize {
        self.rows() - self.segments.len()
    }

    /// Returns the time of each row: a mean has the time of its last row, because it is not known
    /// earlier.
    pub(crate) fn timestamps(&self, log: &[Timestamp]) -> Vec<Timestamp> {
        let last = self.width - 1;
        self.starts.iter().map(|&start| log[start as usize + last]).collect()
    }

    pub(crate) fn value(&self, column: &[f64], row: usize) -> f64 {
        let start = self.starts[row] as usize;
        if self.width == 1 {
            column[start]
        } else {
            column[start..start + self.width].iter().sum::<f64>() / self.width as f64
        }
    }
}
