//! Products of tiles, and what becomes of their sums.

use pulp::{Arch, Simd, WithSimd};

#[cfg(target_arch = "x86_64")]
use super::x86::Hardware;
use super::{
    kernel::{Fused, Kernel, Left, ROWS, Tile, Widened},
    layout::{HALF, PANEL, Panels, Rows},
};

/// What becomes of the sums of a tile.
pub(super) trait Finish {
    /// What the sums of a panel of columns begin with.
    fn begin(&self, _panel: usize) -> [f32; PANEL] {
        [0.0; PANEL]
    }

    /// Take the sums of `rows` rows, the first of which has an even number.
    fn finish<K: Kernel>(
        &mut self,
        kernel: K,
        sums: &mut Tile,
        first_row: usize,
        rows: usize,
        panel: usize,
    );
}

/// The left operand of a product.
#[derive(Clone, Copy)]
pub(super) enum LeftOperand<'a> {
    /// The rows of a matrix from this one on.
    Rows(&'a Rows, usize),
    /// The columns of a matrix.
    Columns(&'a Panels),
    /// One row of these pairs.
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

/// Tile by tile: all rows with one panel of columns, then with the next one.
#[expect(
    clippy::inline_always,
    reason = "only what is inlined into the dispatch is compiled for the processor"
)]
#[inline(always)]
pub(super) fn run<K: Kernel, F: Finish>(kernel: K, product: Product<'_, F>) {
    let Product { left, rows, right, columns, finish } = product;
    let mut sums = Tile([[0.0; PANEL]; ROWS]);
    for panel in 0..columns.div_ceil(PANEL) {
        let (begin, right) = (finish.begin(panel), right.panel(panel));
        for first_row in (0..rows).step_by(ROWS) {
            let count = ROWS.min(rows - first_row);
            let left = left.tile(first_row);
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
            finish.finish(kernel, &mut sums, first_row, count, panel);
        }
    }
}

/// What makes the products; the bytes are the same.
#[derive(Clone, Copy, Debug)]
pub(super) enum Processor {
    /// An instruction for two products and their sums.
    #[cfg(target_arch = "x86_64")]
    Hardware(Hardware),
    /// Fused multiply-adds of these vectors, or what is the same.
    Portable(Arch),
}

impl Processor {
    /// The fastest of this machine.
    pub(super) fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if let Some(hardware) = Hardware::detect() {
            return Self::Hardware(hardware);
        }
        Self::Portable(Arch::new())
    }

    /// All that this machine can be, the fastest first.
    #[cfg(test)]
    pub(super) fn all() -> Vec<Self> {
        let mut all =
            vec![Self::detect(), Self::Portable(Arch::new()), Self::Portable(Arch::Scalar)];
        #[cfg(target_arch = "x86_64")]
        all.extend(pulp::x86::V3::try_new().map(|level| Self::Portable(Arch::V3(level))));
        all
    }

    /// Make a product.
    pub(super) fn run<F: Finish>(self, product: Product<'_, F>) {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Hardware(hardware) => hardware.run(product),
            Self::Portable(Arch::Scalar) => run(Widened, product),
            Self::Portable(arch) => arch.dispatch(product),
        }
    }

    /// The product of two rows.
    pub(super) fn dot(self, a: &[[u32; HALF]], b: &[[u32; HALF]]) -> f32 {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Hardware(hardware) => hardware.dot(a, b),
            Self::Portable(Arch::Scalar) => Widened.dot(a, b),
            Self::Portable(arch) => arch.dispatch(Dot { a, b }),
        }
    }
}

impl<F: Finish> WithSimd for Product<'_, F> {
    type Output = ();

    #[expect(clippy::inline_always, reason = "as the kernel")]
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        run(Fused(simd), self);
    }
}

struct Dot<'a> {
    a: &'a [[u32; HALF]],
    b: &'a [[u32; HALF]],
}

impl WithSimd for Dot<'_> {
    type Output = f32;

    #[expect(clippy::inline_always, reason = "as the kernel")]
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f32 {
        Fused(simd).dot(self.a, self.b)
    }
}
