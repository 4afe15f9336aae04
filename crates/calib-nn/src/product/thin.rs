//! Products with one row or column, or with few values. The library would sum them in an order that depends on the processor's
//! vectors.
//!
//! The code uses loops rather than iterator closures, because a closure that is not inlined is compiled without vectors.

use pulp::{Arch, NullaryFnOnce, Simd, WithSimd};

use crate::Matrix;

/// Number of partial sums of a dot product, for any width of the processor's vectors.
const SUMS: usize = 16;

/// Number of vectors that are processed at a time. Their sums or weights stay in registers.
const BLOCK: usize = 4;

/// Computes each value as a dot product of a row of `left` and a column of `right`, both contiguous.
pub(super) fn dots(out: &mut [f32], left: Matrix<'_>, right: Matrix<'_>) {
    let m = left.rows;
    let n = right.columns;
    let columns = right.transposed();
    Arch::new().dispatch(if m >= n {
        Dots { out, many: left, few: columns, strides: [n, 1] }
    } else {
        Dots { out, many: columns, few: left, strides: [1, n] }
    });
}

/// Computes `out[i * strides[0] + j * strides[1]]` = row i of `many` · row j of `few`.
struct Dots<'a> {
    out: &'a mut [f32],
    many: Matrix<'a>,
    few: Matrix<'a>,
    strides: [usize; 2],
}

impl WithSimd for Dots<'_> {
    type Output = ();

    #[expect(
        clippy::inline_always,
        reason = "only what is inlined into the dispatch is compiled for the processor"
    )]
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { out, many, few, strides } = self;
        let whole = many.rows - many.rows % BLOCK;
        for j in 0..few.rows {
            let vector = few.row(j);
            for i in (0..whole).step_by(BLOCK) {
                let rows = [many.row(i), many.row(i + 1), many.row(i + 2), many.row(i + 3)];
                for (place, value) in dot_products(simd, rows, vector).into_iter().enumerate() {
                    out[(i + place) * strides[0] + j * strides[1]] = value;
                }
            }
            for i in whole..many.rows {
                let [value] = dot_products(simd, [many.row(i)], vector);
                out[i * strides[0] + j * strides[1]] = value;
            }
        }
    }
}

/// Adds product l to sum l mod 16 by a fused multiply-add, and then adds the sums by halves. Incomplete vectors are padded
/// with zeros.
#[expect(
    clippy::inline_always,
    reason = "only what is inlined into the dispatch is compiled for the processor"
)]
#[inline(always)]
fn dot_products<S: Simd, const ROWS: usize>(
    simd: S,
    rows: [&[f32]; ROWS],
    vector: &[f32],
) -> [f32; ROWS] {
    let vectors = const { SUMS / S::F32_LANES };
    let mut sums = [[simd.splat_f32s(0.0); SUMS]; ROWS];
    let (chunks, rest) = vector.as_chunks::<SUMS>();
    for (index, chunk) in chunks.iter().enumerate() {
        let chunk = S::as_simd_f32s(chunk).0;
        for (sums, row) in sums.iter_mut().zip(rows) {
            let row = S::as_simd_f32s(&row[index * SUMS..][..SUMS]).0;
            for vector in 0..vectors {
                sums[vector] = simd.mul_add_f32s(row[vector], chunk[vector], sums[vector]);
            }
        }
    }
    if !rest.is_empty() {
        let chunk = padded(rest);
        let chunk = S::as_simd_f32s(&chunk).0;
        for (sums, row) in sums.iter_mut().zip(rows) {
            let row = padded(&row[chunks.len() * SUMS..]);
            let row = S::as_simd_f32s(&row).0;
            for vector in 0..vectors {
                sums[vector] = simd.mul_add_f32s(row[vector], chunk[vector], sums[vector]);
            }
        }
    }
    let mut values = [0.0; ROWS];
    for (value, sums) in values.iter_mut().zip(&mut sums) {
        let mut half = vectors / 2;
        while half > 0 {
            for vector in 0..half {
                sums[vector] = simd.add_f32s(sums[vector], sums[vector + half]);
            }
            half /= 2;
        }
        *value = simd.reduce_sum_f32s(sums[0]);
    }
    values
}

/// Returns `values`, fewer than [`SUMS`], padded with zeros.
#[expect(clippy::inline_always, reason = "as the loops around it")]
#[inline(always)]
fn padded(values: &[f32]) -> [f32; SUMS] {
    let mut padded = [0.0; SUMS];
    padded[..values.len()].copy_from_slice(values);
    padded
}

/// Computes each row of the result as a sum of the rows of `right`, which are contiguous, one after another.
pub(super) fn combine(out: &mut [f32], left: Matrix<'_>, right: Matrix<'_>) {
    Arch::new().dispatch(Combine { out, left, right });
}

struct Combine<'a> {
    out: &'a mut [f32],
    left: Matrix<'a>,
    right: Matrix<'a>,
}

impl NullaryFnOnce for Combine<'_> {
    type Output = ();

    #[expect(
        clippy::inline_always,
        reason = "only what is inlined into the dispatch is compiled for the processor"
    )]
    #[inline(always)]
    fn call(self) {
        let Self { out, left, right } = self;
        let k = left.columns;
        let n = right.columns;
        if k == 0 {
            return out.fill(0.0);
        }
        let whole = k - k % BLOCK;
        for (i, out) in out.chunks_exact_mut(n).enumerate() {
            for l in (0..whole).step_by(BLOCK) {
                let rows = [right.row(l), right.row(l + 1), right.row(l + 2), right.row(l + 3)];
                let weights =
                    [left.at(i, l), left.at(i, l + 1), left.at(i, l + 2), left.at(i, l + 3)];
                if l == 0 {
                    add_scaled::<_, true>(out, weights, rows);
                } else {
                    add_scaled::<_, false>(out, weights, rows);
                }
            }
            for l in whole..k {
                let weights = [left.at(i, l)];
                let rows = [right.row(l)];
                if l == 0 {
                    add_scaled::<_, true>(out, weights, rows);
                } else {
                    add_scaled::<_, false>(out, weights, rows);
                }
            }
        }
    }
}

/// Computes `out` += Σ `weights`ₗ · `rows`ₗ, one row after the other, by fused multiply-adds. The old content is ignored if
/// `FRESH`.
#[expect(
    clippy::inline_always,
    reason = "only what is inlined into the dispatch is compiled for the processor"
)]
#[inline(always)]
fn add_scaled<const ROWS: usize, const FRESH: bool>(
    out: &mut [f32],
    weights: [f32; ROWS],
    rows: [&[f32]; ROWS],
) {
    let rows = rows.map(|row| &row[..out.len()]);
    for (index, out) in out.iter_mut().enumerate() {
        let mut sum = if FRESH { 0.0 } else { *out };
        for place in 0..ROWS {
            sum = weights[place].mul_add(rows[place][index], sum);
        }
        *out = sum;
    }
}
