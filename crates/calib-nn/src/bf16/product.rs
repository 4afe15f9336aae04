//! Products of tiles, and the further processing of their sums.

use super::{
    kernel::{Kernel, Left, ROWS, Tile},
    layout::{Panels, Rows},
    panel::{HALF, PANEL},
    task::Task,
};

/// The processing of a tile's sums.
pub(super) trait Finish {
    /// Returns the initial values of the sums of a panel of columns.
    fn begin(&self, _panel: usize) -> [f32; PANEL] {
        [0.0; PANEL]
    }

    /// Announces that the sums of `rows` rows come next.
    fn prepare<K: Kernel>(&self, _kernel: K, _first_row: usize, _rows: usize, _panel: usize) {}

    /// Processes the sums of some rows. The first row number is even. The results are written to separate memory. Changing
    /// the sums in place would write parts of vectors, and a processor cannot read those again before they are in its cache.
    fn finish<K: Kernel>(
        &mut self,
        kernel: K,
        sums: &[[f32; PANEL]],
        room: &mut Tile,
        first_row: usize,
        panel: usize,
    );
}

/// The left operand of a product.
#[derive(Clone, Copy)]
pub(super) enum LeftOperand<'a> {
    /// The rows of a matrix, from this one on.
    Rows(&'a Rows, usize),
    /// The columns of a matrix.
    Columns(&'a Panels),
    /// One row, with these pairs.
    Row(&'a [u32]),
}

impl<'a> LeftOperand<'a> {
    #[expect(clippy::inline_always, reason = "as what calls it")]
    #[inline(always)]
    fn tile(self, first_row: usize) -> Left<'a> {
        match self {
            Self::Rows(rows, offset) => Left {
                pairs: rows.from(offset + first_row).as_flattened(),
                row_stride: rows.stride() * HALF,
                pair_stride: 1,
            },
            Self::Columns(panels) => Left {
                pairs: &panels.panel(first_row / PANEL).as_flattened()[first_row % PANEL..],
                row_stride: 1,
                pair_stride: PANEL,
            },
            Self::Row(pairs) => Left { pairs, row_stride: 0, pair_stride: 1 },
        }
    }
}

/// The product of `rows` rows with the panels of a right operand.
pub(super) struct Product<'a, F> {
    pub(super) left: LeftOperand<'a>,
    pub(super) rows: usize,
    pub(super) right: &'a Panels,
    pub(super) columns: usize,
    pub(super) finish: &'a mut F,
}

impl<F: Finish> Task for Product<'_, F> {
    type Output = ();

    /// Computes tile by tile: all rows with one panel of columns, then with the next.
    #[expect(
        clippy::inline_always,
        reason = "only what is inlined into the dispatch is compiled for the processor"
    )]
    #[inline(always)]
    fn run<K: Kernel>(self, kernel: K) {
        let Product { left, rows, right, columns, finish } = self;
        let mut sums = Tile([[0.0; PANEL]; ROWS]);
        let mut room = Tile([[0.0; PANEL]; ROWS]);
        for panel in 0..columns.div_ceil(PANEL) {
            let mut next = right.shares(panel + 1, rows.div_ceil(ROWS));
            let begin = finish.begin(panel);
            let right = right.panel(panel);
            for first_row in (0..rows).step_by(ROWS) {
                let count = ROWS.min(rows - first_row);
                let left = left.tile(first_row);
                finish.prepare(kernel, first_row, count, panel);
                next.next().into_iter().for_each(|share| kernel.prefetch(share));
                match count {
                    1 => kernel.sum::<1>(&begin, left, right, &mut sums),
                    2 => kernel.sum::<2>(&begin, left, right, &mut sums),
                    3 => kernel.sum::<3>(&begin, left, right, &mut sums),
                    4 => kernel.sum::<4>(&begin, left, right, &mut sums),
                    5 => kernel.sum::<5>(&begin, left, right, &mut sums),
                    6 => kernel.sum::<6>(&begin, left, right, &mut sums),
                    7 => kernel.sum::<7>(&begin, left, right, &mut sums),
                    _ => kernel.sum::<ROWS>(&begin, left, right, &mut sums),
                }
                // Most tiles are whole. Then the compiler knows the number of rows.
                if count == ROWS {
                    finish.finish(kernel, &sums.0, &mut room, first_row, panel);
                } else {
                    finish.finish(kernel, &sums.0[..count], &mut room, first_row, panel);
                }
            }
        }
    }
}

/// The dot product of two rows.
pub(super) struct Dot<'a> {
    pub(super) a: &'a [[u32; HALF]],
    pub(super) b: &'a [[u32; HALF]],
}

impl Task for Dot<'_> {
    type Output = f32;

    #[expect(clippy::inline_always, reason = "as the product")]
    #[inline(always)]
    fn run<K: Kernel>(self, kernel: K) -> f32 {
        kernel.dot(self.a, self.b)
    }
}
