//! A strip of the query: sixteen lanes × height rows, and the windows of its rows.

use std::ops::Range;

use super::lanes::{LANES, Pack};
use crate::{Series, Window};

/// Where the rows of a strip lie.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Strip {
    /// First query sample.
    pub(crate) first: usize,
    /// Rows of a lane.
    pub(crate) height: usize,
    /// Samples of the whole query.
    pub(crate) query: usize,
}

impl Strip {
    /// The rows that exist.
    pub(crate) fn rows(&self) -> Range<usize> {
        self.first..(self.first + LANES * self.height).min(self.query)
    }

    /// Lane and row in the lane of query sample `index`.
    pub(crate) fn place(&self, index: usize) -> (usize, usize) {
        let row = index - self.first;
        (row / self.height, row % self.height)
    }

    /// The last lane that has rows.
    pub(crate) fn last_lane(&self) -> usize {
        self.place(self.rows().end - 1).0
    }

    /// The reference samples that are open to any row, below `limit`.
    pub(crate) fn columns(&self, window: Window, reference: usize, limit: usize) -> Range<usize> {
        let rows = self.rows();
        let first = window.columns(rows.start, self.query, reference);
        let last = window.columns(rows.end - 1, self.query, reference);
        first.start..last.end.min(limit)
    }

    /// The query's values, `[channels, halo + height]` packs; rows that do not exist repeat one
    /// that does, so that every lane computes with finite numbers.
    pub(crate) fn load(&self, series: Series<'_>, halo: usize, out: &mut Vec<Pack>) {
        out.clear();
        for channel in 0..series.channels() {
            for row in 0..halo + self.height {
                let mut pack = Pack::splat(0.0);
                for (lane, value) in pack.0.iter_mut().enumerate() {
                    let index = (self.first + lane * self.height + row).saturating_sub(halo);
                    *value = series.sample(index.min(self.query - 1))[channel];
                }
                out.push(pack);
            }
        }
    }

    /// First and last open reference sample of every row, as the masked kernels want them.
    pub(crate) fn limits(
        &self,
        window: Window,
        reference: usize,
        low: &mut [Pack],
        high: &mut [Pack],
    ) {
        for row in 0..self.height {
            for lane in 0..LANES {
                let index = self.first + lane * self.height + row;
                let open = if index < self.query {
                    window.columns(index, self.query, reference)
                } else {
                    0..0
                };
                (low[row].0[lane], high[row].0[lane]) = if open.is_empty() {
                    (f64::INFINITY, f64::NEG_INFINITY)
                } else {
                    (open.start as f64, (open.end - 1) as f64)
                };
            }
        }
    }
}

/// Rows of a lane for a query of `query` samples: enough to amortise the borders of a strip, few
/// enough to stay in the first-level cache and not to compute much outside a narrow window.
pub(crate) fn height_for(
    query: usize,
    reference: usize,
    window: Window,
    halo: usize,
    most: usize,
) -> usize {
    let middle = window.columns(query / 2, query, reference).len();
    let most = most.min(middle.div_ceil(LANES)).max(4);
    let strips = query.div_ceil(LANES * most);
    query.div_ceil(LANES * strips).max(halo).max(2)
}
