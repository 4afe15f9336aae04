//! The last rows of a strip: all that the next strip needs from the rows above it.

use std::ops::Range;

use crate::pattern::LONGEST_BRANCH;

const CLOSED: [f64; LONGEST_BRANCH] = [f64::INFINITY; LONGEST_BRANCH];

/// Cumulated distances `f64 [M, halo]` of the rows just above a strip, nearest row first. They are
/// +∞ outside `columns`.
#[derive(Clone, Debug)]
pub(crate) struct Boundary {
    values: Vec<f64>,
    halo: usize,
    columns: Range<usize>,
}

impl Boundary {
    /// Creates a boundary with no paths above: +∞ everywhere.
    pub(crate) fn closed(halo: usize) -> Self {
        Self { values: Vec::new(), halo, columns: 0..0 }
    }

    /// Creates a virtual row of zeros above the first row, so that a path may begin at any
    /// reference sample.
    pub(crate) fn open(halo: usize, reference: usize) -> Self {
        let mut boundary = Self::closed(halo);
        boundary.reset(0..reference);
        for column in boundary.values.chunks_exact_mut(halo.max(1)) {
            column.fill(f64::INFINITY);
            column[0] = 0.0;
        }
        boundary
    }

    /// Makes room for `columns`, which must then be written one by one.
    pub(crate) fn reset(&mut self, columns: Range<usize>) {
        self.values.resize(columns.end * self.halo, f64::INFINITY);
        self.columns = columns;
    }

    /// Returns the `halo` cells above column `column`, nearest row first.
    pub(crate) fn above(&self, column: usize) -> &[f64] {
        if self.columns.contains(&column) {
            &self.values[column * self.halo..][..self.halo]
        } else {
            &CLOSED[..self.halo]
        }
    }

    /// Returns the cells of one column, for writing.
    pub(crate) fn above_mut(&mut self, column: usize) -> &mut [f64] {
        &mut self.values[column * self.halo..][..self.halo]
    }
}
