//! The sums of a tile, for processors without the instruction. `x86.rs` is for those that have it.

use pulp::{Scalar, Simd};

use super::{
    number::{firsts, join, seconds},
    panel::{HALF, PANEL},
};

/// Maximum number of rows in a tile.
pub(super) const ROWS: usize = 8;

/// Sums of some rows and the columns of one panel.
#[derive(Clone, Debug)]
#[repr(align(64))]
pub(super) struct Tile(pub(super) [[f32; PANEL]; ROWS]);

/// Half a block of pairs, for sixteen rows.
pub(super) type Square = [[u32; HALF]; HALF];

/// Rows of a left operand: pair p of row i is `pairs[i * row_stride + p * pair_stride]`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Left<'a> {
    pub(super) pairs: &'a [u32],
    pub(super) row_stride: usize,
    pub(super) pair_stride: usize,
}

impl Left<'_> {
    /// Whether all pairs of this many rows lie inside the operand.
    pub(super) fn holds(&self, rows: usize, pairs: usize) -> bool {
        let row = rows.saturating_sub(1) * self.row_stride;
        row + pairs.saturating_sub(1) * self.pair_stride < self.pairs.len()
    }
}

/// A vector of a kernel.
pub(super) type Vector<K> = <<K as Kernel>::Simd as Simd>::f32s;

/// A vector of pairs.
pub(super) type Pairs<K> = <<K as Kernel>::Simd as Simd>::u32s;

/// A method for summing products. All methods give the same bytes.
pub(super) trait Kernel: Copy {
    /// Vectors for all operations but the sums.
    type Simd: Simd;

    /// Returns the vectors for all operations but the sums.
    fn simd(self) -> Self::Simd;

    /// Hints that these values are read soon, so that the cache may load them.
    fn prefetch<T>(self, _values: &[T]) {}

    /// Returns pairs of two vectors, rounded. The first vector is in the lower halves; see [`join`].
    fn join(self, first: Vector<Self>, second: Vector<Self>) -> Pairs<Self>;

    /// Returns the transpose.
    #[expect(clippy::inline_always, reason = "as the sums")]
    #[inline(always)]
    fn turn(self, square: &Square) -> Square {
        let mut turned = [[0; HALF]; HALF];
        for (column, turned) in turned.iter_mut().enumerate() {
            for (to, row) in turned.iter_mut().zip(square) {
                *to = row[column];
            }
        }
        turned
    }

    /// Computes `begin`\[j\] + Σₚ left(i, p) · panel\[p\]\[j\] for the first `COUNT` rows. For one p after the other, it adds the
    /// product of the second numbers, then that of the first, each by a fused multiply-add.
    fn sum<const COUNT: usize>(
        self,
        begin: &[f32; PANEL],
        left: Left<'_>,
        panel: &[[u32; PANEL]],
        sums: &mut Tile,
    );

    /// Computes Σₚ a\[p\] · b\[p\] in sixteen sums, with pair p in sum p mod 16. The sums are added by halves.
    fn dot(self, a: &[[u32; HALF]], b: &[[u32; HALF]]) -> f32;
}

/// A kernel that uses fused multiply-adds of the processor's vectors.
#[derive(Clone, Copy)]
pub(super) struct Fused<S>(pub(super) S);

impl<S: Simd> Kernel for Fused<S> {
    type Simd = S;

    #[expect(clippy::inline_always, reason = "as the sums")]
    #[inline(always)]
    fn simd(self) -> S {
        self.0
    }

    #[expect(clippy::inline_always, reason = "as the sums")]
    #[inline(always)]
    fn join(self, first: S::f32s, second: S::f32s) -> S::u32s {
        join(self.0, first, second)
    }

    #[expect(
        clippy::inline_always,
        reason = "only what is inlined into the dispatch is compiled for the processor"
    )]
    #[inline(always)]
    fn sum<const COUNT: usize>(
        self,
        begin: &[f32; PANEL],
        left: Left<'_>,
        panel: &[[u32; PANEL]],
        sums: &mut Tile,
    ) {
        // As many rows at a time as the registers can hold sums for.
        let at_once = const { if S::F32_LANES >= 16 { 4 } else { 2 } };
        let whole = COUNT - COUNT % at_once;
        for row in (0..whole).step_by(at_once) {
            if at_once == 4 {
                self.sum_rows::<4>(row, begin, left, panel, sums);
            } else {
                self.sum_rows::<2>(row, begin, left, panel, sums);
            }
        }
        for row in whole..COUNT {
            self.sum_rows::<1>(row, begin, left, panel, sums);
        }
    }

    #[expect(clippy::inline_always, reason = "as above")]
    #[inline(always)]
    fn dot(self, a: &[[u32; HALF]], b: &[[u32; HALF]]) -> f32 {
        let simd = self.0;
        let vectors = const { HALF / S::F32_LANES };
        let mut sums = [simd.splat_f32s(0.0); HALF];
        for (a, b) in a.iter().zip(b) {
            let a = S::as_simd_u32s(a).0;
            let b = S::as_simd_u32s(b).0;
            for vector in 0..vectors {
                let a = a[vector];
                let b = b[vector];
                let sum = simd.mul_add_f32s(seconds(simd, a), seconds(simd, b), sums[vector]);
                sums[vector] = simd.mul_add_f32s(firsts(simd, a), firsts(simd, b), sum);
            }
        }
        let mut lanes = [0.0; HALF];
        let to = S::as_mut_simd_f32s(&mut lanes).0;
        to.copy_from_slice(&sums[..vectors]);
        by_halves(lanes)
    }
}

impl<S: Simd> Fused<S> {
    /// Computes the sums of `COUNT` rows, starting with this one; see [`Kernel::sum`].
    #[expect(clippy::inline_always, reason = "as the sums")]
    #[inline(always)]
    fn sum_rows<const COUNT: usize>(
        self,
        first_row: usize,
        begin: &[f32; PANEL],
        left: Left<'_>,
        panel: &[[u32; PANEL]],
        sums: &mut Tile,
    ) {
        let simd = self.0;
        let vectors = const { PANEL / S::F32_LANES };
        let begin = S::as_simd_f32s(begin).0;
        let mut kept = [[simd.splat_f32s(0.0); PANEL]; COUNT];
        for kept in &mut kept {
            kept[..vectors].copy_from_slice(begin);
        }
        for (index, block) in panel.iter().enumerate() {
            let block = S::as_simd_u32s(block).0;
            let at = first_row * left.row_stride + index * left.pair_stride;
            for (row, kept) in kept.iter_mut().enumerate() {
                let pair = left.pairs[at + row * left.row_stride];
                let a0 = simd.splat_f32s(firsts(Scalar, pair));
                let a1 = simd.splat_f32s(seconds(Scalar, pair));
                for vector in 0..vectors {
                    let pairs = block[vector];
                    let sum = simd.mul_add_f32s(a1, seconds(simd, pairs), kept[vector]);
                    kept[vector] = simd.mul_add_f32s(a0, firsts(simd, pairs), sum);
                }
            }
        }
        for (row, kept) in kept.iter().enumerate() {
            let sums = S::as_mut_simd_f32s(&mut sums.0[first_row + row]).0;
            sums.copy_from_slice(&kept[..vectors]);
        }
    }
}

/// A kernel for processors without fused multiply-adds, which uses double precision.
#[derive(Clone, Copy)]
pub(super) struct Widened;

impl Kernel for Widened {
    type Simd = Scalar;

    fn simd(self) -> Scalar {
        Scalar
    }

    fn join(self, first: f32, second: f32) -> u32 {
        join(Scalar, first, second)
    }

    fn sum<const COUNT: usize>(
        self,
        begin: &[f32; PANEL],
        left: Left<'_>,
        panel: &[[u32; PANEL]],
        sums: &mut Tile,
    ) {
        for (row, sums) in sums.0.iter_mut().take(COUNT).enumerate() {
            *sums = *begin;
            for (index, block) in panel.iter().enumerate() {
                let pair = left.pairs[row * left.row_stride + index * left.pair_stride];
                for (sum, &other) in sums.iter_mut().zip(block) {
                    *sum = add_pair(pair, other, *sum);
                }
            }
        }
    }

    fn dot(self, a: &[[u32; HALF]], b: &[[u32; HALF]]) -> f32 {
        let mut sums = [0.0; HALF];
        for (a, b) in a.iter().zip(b) {
            for (sum, (&a, &b)) in sums.iter_mut().zip(a.iter().zip(b)) {
                *sum = add_pair(a, b, *sum);
            }
        }
        by_halves(sums)
    }
}

fn add_pair(a: u32, b: u32, sum: f32) -> f32 {
    let sum = widened(seconds(Scalar, a), seconds(Scalar, b), sum);
    widened(firsts(Scalar, a), firsts(Scalar, b), sum)
}

/// Returns `a` · `b` + `c`, rounded once, for bfloat16 `a` and `b`.
///
/// The product has 16 significant bits and `c` has 24. Their sum in double precision, 53 bits, is exact unless one of the two lies
/// wholly below the 28th bit of the other. Such a sum is not a tie of single precision, so rounding it twice is the same as rounding
/// it once.
fn widened(a: f32, b: f32, c: f32) -> f32 {
    (f64::from(a) * f64::from(b) + f64::from(c)) as f32
}

/// Returns the sum of sixteen values, added by halves.
#[expect(clippy::inline_always, reason = "as its callers")]
#[inline(always)]
pub(super) fn by_halves(sums: [f32; HALF]) -> f32 {
    let eight: [f32; 8] = std::array::from_fn(|lane| sums[lane] + sums[lane + 8]);
    let four: [f32; 4] = std::array::from_fn(|lane| eight[lane] + eight[lane + 4]);
    (four[0] + four[2]) + (four[1] + four[3])
}

#[cfg(test)]
mod tests;
