//! A strip of the query: sixteen lanes × height rows, and the windows of its rows.

use std::ops::Range;

use super::lanes::{LANES, Pack};
use crate::{Series, Window};

/// The position of a strip in the query.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Strip {
    /// First query sample of the strip.
    pub(crate) first: usize,
    /// Rows per lane.
    pub(crate) height: usize,
    /// Number of samples of the whole query.
    pub(crate) query: usize,
}

impl Strip {
    /// Returns the query samples of the strip.
    pub(crate) fn rows(&self) -> Range<usize> {
        self.first..(self.first + LANES * self.height).min(self.query)
    }

    /// Returns the lane of query sample `index`, and its row in the lane.
    pub(crate) fn place(&self, index: usize) -> (usize, usize) {
        let row = index - self.first;
        (row / self.height, row % self.height)
    }

    /// Returns the last lane that has rows.
    pub(crate) fn last_lane(&self) -> usize {
        self.place(self.rows().end - 1).0
    }

    /// Returns the reference samples below `limit` that are open to any row.
    pub(crate) fn columns(&self, window: Window, reference: usize, limit: usize) -> Range<usize> {
        let rows = self.rows();
        let first = window.columns(rows.start, self.query, reference);
        let last = window.columns(rows.end - 1, self.query, reference);
        first.start..last.end.min(limit)
    }

    /// Loads the query's values, `[channels, halo + height]` packs. Rows that do not exist repeat
    /// one that does, so that every lane computes with finite numbers.
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

    /// Computes the first and last open reference sample of every row, in the form that the masked
    /// kernels need.
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

/// Returns the rows per lane for a query of `query` samples. The strip is high enough to amortise
/// its borders. It is low enough to fit in the first-level cache and to compute little outside a
/// narrow window.
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
