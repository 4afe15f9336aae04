//! The memory layout of bfloat16 pairs, in which a product reads both operands in order.
//!
//! The inner index of a product is divided into pairs, in the same way for both operands:
//!
//! - features (the columns of inputs and activations) in blocks of 32. The first half of a block is paired with the second,
//!   number i with number i + 16, so that pairs are made of whole vectors. A last, shorter block of m is halved at ⌈m / 2⌉;
//! - rows of a batch in neighbours, 2p and 2p + 1.
//!
//! If a last pair is incomplete, its second number is 0.

use pulp::Simd;

use super::{
    kernel::Kernel,
    number::without_small,
    panel::{HALF, PANEL},
    processor::Processor,
    task::Task,
};
use crate::aligned::{Aligned, filled};

/// Returns the number of pairs of `count` features.
pub(super) fn feature_pairs(count: usize) -> usize {
    count / PANEL * HALF + (count % PANEL).div_ceil(2)
}

/// Returns the number of pairs in the block of features that begins at `first`, of `count` in all.
pub(super) fn half_of_block(first: usize, count: usize) -> usize {
    PANEL.min(count - first).div_ceil(2)
}

/// A matrix stored by rows, in pairs of features. It is the left operand of products over its columns.
#[derive(Clone, Debug)]
pub(super) struct Rows {
    pairs: Aligned<[u32; HALF]>,
    columns: usize,
}

impl Rows {
    /// Creates a matrix of zeros.
    pub(super) fn new(rows: usize, columns: usize) -> Self {
        Self { pairs: filled([0; HALF], rows * columns.div_ceil(PANEL)), columns }
    }

    /// Returns the number of features.
    pub(super) fn columns(&self) -> usize {
        self.columns
    }

    /// Returns the number of blocks from one row to the next.
    pub(super) fn stride(&self) -> usize {
        self.columns.div_ceil(PANEL)
    }

    /// Returns the rows from this one on, block after block.
    pub(super) fn from(&self, row: usize) -> &[[u32; HALF]] {
        &self.pairs[row * self.stride()..]
    }

    /// Returns one block of each row, from this row on.
    pub(super) fn blocks_mut(
        &mut self,
        row: usize,
        block: usize,
    ) -> impl Iterator<Item = &mut [u32; HALF]> {
        let stride = self.stride();
        self.pairs[row * stride + block..].iter_mut().step_by(stride)
    }

    /// Sets the first rows to these values.
    #[expect(
        clippy::inline_always,
        reason = "only what is inlined into the dispatch is compiled for the processor"
    )]
    #[inline(always)]
    fn fill<K: Kernel>(&mut self, kernel: K, values: &[f32]) {
        let columns = self.columns;
        let stride = self.stride();
        for (row, values) in self.pairs.chunks_exact_mut(stride).zip(values.chunks_exact(columns)) {
            for (pairs, values) in row.iter_mut().zip(values.chunks(PANEL)) {
                *pairs = block_of(kernel, values);
            }
        }
    }
}

/// Returns the pairs of a block of features.
#[expect(clippy::inline_always, reason = "as what calls it")]
#[inline(always)]
fn block_of<K: Kernel>(kernel: K, values: &[f32]) -> [u32; HALF] {
    let half = values.len().div_ceil(2);
    match values.as_array::<PANEL>() {
        Some(whole) => joined(kernel, halves(whole)),
        None => joined(kernel, [&part(&values[..half]), &part(&values[half..])]),
    }
}

#[expect(clippy::inline_always, reason = "as what calls it")]
#[inline(always)]
pub(super) fn halves(block: &[f32; PANEL]) -> [&[f32; HALF]; 2] {
    let (halves, _) = block.as_chunks::<HALF>();
    [&halves[0], &halves[1]]
}

/// Returns `values`, at most half a panel, padded with zeros.
pub(super) fn part(values: &[f32]) -> [f32; HALF] {
    let mut part = [0.0; HALF];
    part[..values.len()].copy_from_slice(values);
    part
}

/// Returns `values` if they are a whole panel. Otherwise copies them to `room`, which must contain zeros, and returns that.
#[expect(clippy::inline_always, reason = "as what calls it")]
#[inline(always)]
fn whole<'a>(values: &'a [f32], room: &'a mut [f32; PANEL]) -> &'a [f32; PANEL] {
    if let Some(whole) = values.as_array::<PANEL>() {
        return whole;
    }
    room[..values.len()].copy_from_slice(values);
    room
}

/// Returns the pairs of first and second numbers.
#[expect(clippy::inline_always, reason = "as what calls it")]
#[inline(always)]
fn joined<K: Kernel>(kernel: K, [first, second]: [&[f32; HALF]; 2]) -> [u32; HALF] {
    let simd = kernel.simd();
    let mut pairs = [0; HALF];
    let first = K::Simd::as_simd_f32s(first).0;
    let second = K::Simd::as_simd_f32s(second).0;
    let vectors = const { HALF / K::Simd::F32_LANES };
    let to = K::Simd::as_mut_simd_u32s(&mut pairs).0;
    for vector in 0..vectors {
        let first = without_small(simd, first[vector]);
        to[vector] = kernel.join(first, without_small(simd, second[vector]));
    }
    pairs
}

/// The way in which the rows of [`Panels`] are paired.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pairing {
    /// The rows are features.
    Features,
    /// The rows belong to a batch.
    Neighbours,
}

impl Pairing {
    fn pairs(self, rows: usize) -> usize {
        match self {
            Self::Features => feature_pairs(rows),
            Self::Neighbours => rows.div_ceil(2),
        }
    }

    /// Returns the two rows of a pair, of `rows` in all. The second may be missing.
    fn rows(self, pair: usize, rows: usize) -> (usize, Option<usize>) {
        let (first, second) = match self {
            Self::Features => {
                let block = pair / HALF * PANEL;
                let first = block + pair % HALF;
                (first, first + half_of_block(block, rows))
            }
            Self::Neighbours => (2 * pair, 2 * pair + 1),
        };
        (first, (second < rows).then_some(second))
    }
}

/// A matrix stored in panels of [`PANEL`] columns, in pairs of rows.
///
/// It is an operand of products over its rows. As a right operand it has its own columns; as a left operand, its columns
/// serve as rows.
#[derive(Clone, Debug)]
pub(super) struct Panels {
    /// The blocks, `[panels][pairs][PANEL]`.
    blocks: Aligned<[u32; PANEL]>,
    pairing: Pairing,
    /// Number of pairs per column.
    pairs: usize,
}

impl Panels {
    /// Creates a matrix of zeros with capacity for this many rows and columns.
    pub(super) fn new(pairing: Pairing, rows: usize, columns: usize) -> Self {
        let pairs = pairing.pairs(rows);
        Self { blocks: filled([0; PANEL], columns.div_ceil(PANEL) * pairs), pairing, pairs }
    }

    /// Sets the number of rows, at most the capacity. The old content is lost.
    pub(super) fn set_rows(&mut self, rows: usize) {
        self.pairs = self.pairing.pairs(rows);
    }

    /// Returns one panel, pair after pair.
    pub(super) fn panel(&self, panel: usize) -> &[[u32; PANEL]] {
        &self.blocks[panel * self.pairs..][..self.pairs]
    }

    /// Returns one panel, if it exists, in at most `count` parts.
    pub(super) fn shares(
        &self,
        panel: usize,
        count: usize,
    ) -> impl Iterator<Item = &[[u32; PANEL]]> {
        let blocks = self.blocks.get(panel * self.pairs..(panel + 1) * self.pairs);
        blocks.unwrap_or_default().chunks(self.pairs.div_ceil(count.max(1)).max(1))
    }

    /// Returns one panel, pair after pair.
    pub(super) fn panel_mut(&mut self, panel: usize) -> &mut [[u32; PANEL]] {
        &mut self.blocks[panel * self.pairs..][..self.pairs]
    }

    /// Sets the matrix to rows of `columns` values each.
    #[expect(clippy::inline_always, reason = "as that of rows")]
    #[inline(always)]
    fn fill<K: Kernel>(&mut self, kernel: K, values: &[f32], columns: usize) {
        let rows = values.len() / columns;
        self.set_rows(rows);
        let pairing = self.pairing;
        let zeros = [0.0; PANEL];
        for panel in 0..columns.div_ceil(PANEL) {
            let first = panel * PANEL;
            let width = PANEL.min(columns - first);
            for (pair, block) in self.panel_mut(panel).iter_mut().enumerate() {
                let (upper, lower) = pairing.rows(pair, rows);
                let part = |row: usize| &values[row * columns + first..][..width];
                let mut above = zeros;
                let mut below = zeros;
                let upper = whole(part(upper), &mut above);
                let lower = lower.map_or(&zeros, |lower| whole(part(lower), &mut below));
                let [u0, u1] = halves(upper);
                let [l0, l1] = halves(lower);
                let (to, _) = block.as_chunks_mut::<HALF>();
                to[0] = joined(kernel, [u0, l0]);
                to[1] = joined(kernel, [u1, l1]);
            }
        }
    }

    /// Sets the matrix to the transpose of rows of `columns` features each: columns become rows.
    #[expect(clippy::inline_always, reason = "as that of rows")]
    #[inline(always)]
    fn fill_transposed<K: Kernel>(&mut self, kernel: K, values: &[f32], columns: usize) {
        self.set_rows(columns);
        for (panel, rows) in values.chunks(PANEL * columns).enumerate() {
            for (number, blocks) in self.panel_mut(panel).chunks_mut(HALF).enumerate() {
                let mut pairs = [[0; HALF]; PANEL];
                let last = columns.min((number + 1) * PANEL);
                for (pairs, row) in pairs.iter_mut().zip(rows.chunks_exact(columns)) {
                    *pairs = block_of(kernel, &row[number * PANEL..last]);
                }
                let (squares, _) = pairs.as_chunks::<HALF>();
                let turned = [kernel.turn(&squares[0]), kernel.turn(&squares[1])];
                for (place, block) in blocks.iter_mut().enumerate() {
                    let (to, _) = block.as_chunks_mut::<HALF>();
                    to.copy_from_slice(&[turned[0][place], turned[1][place]]);
                }
            }
        }
    }
}

/// A matrix that is set to rounded values.
pub(super) enum Fill<'a> {
    /// Sets the first rows.
    Rows(&'a mut Rows),
    /// Sets all rows, with this many columns.
    Panels(&'a mut Panels, usize),
    /// Sets the transpose of rows with this many columns.
    Transposed(&'a mut Panels, usize),
}

impl Fill<'_> {
    /// Rounds the values and writes them in this layout.
    pub(super) fn with(self, processor: Processor, values: &[f32]) {
        processor.run(Filling { to: self, values });
    }
}

struct Filling<'a> {
    to: Fill<'a>,
    values: &'a [f32],
}

impl Task for Filling<'_> {
    type Output = ();

    #[expect(clippy::inline_always, reason = "as what it calls")]
    #[inline(always)]
    fn run<K: Kernel>(self, kernel: K) {
        let values = self.values;
        match self.to {
            Fill::Rows(rows) => rows.fill(kernel, values),
            Fill::Panels(panels, columns) => panels.fill(kernel, values, columns),
            Fill::Transposed(panels, columns) => panels.fill_transposed(kernel, values, columns),
        }
    }
}

#[cfg(test)]
mod tests;
