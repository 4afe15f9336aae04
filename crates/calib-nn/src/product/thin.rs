//! Products with one row or column, or with few values: the library sums them by the processor's vectors.
//!
//! Loops rather than iterator closures: a closure that is not inlined is compiled without vectors.

use pulp::{Arch, NullaryFnOnce};

use super::Matrix;

/// Partial sums of a dot product, whatever the processor's vectors hold.
const SUMS: usize = 16;

/// Vectors that are taken at a time: their sums, or the weights of them, stay in registers.
const BLOCK: usize = 4;

/// Each value as a dot product of a row of `left` and a column of `right`, both of which lie in order.
pub(super) fn dots(out: &mut [f32], left: Matrix<'_>, right: Matrix<'_>) {
    let (m, n) = (left.rows, right.columns);
    let columns = right.transposed();
    Arch::new().dispatch(if m >= n {
        Dots { out, many: left, few: columns, strides: [n, 1] }
    } else {
        Dots { out, many: columns, few: left, strides: [1, n] }
    });
}

/// `out[i * strides[0] + j * strides[1]]` = row i of `many` · row j of `few`.
struct Dots<'a> {
    out: &'a mut [f32],
    many: Matrix<'a>,
    few: Matrix<'a>,
    strides: [usize; 2],
}

impl NullaryFnOnce for Dots<'_> {
    type Output = ();

    #[expect(
        clippy::inline_always,
        reason = "only what is inlined into the dispatch is compiled for the processor"
    )]
    #[inline(always)]
    fn call(self) {
        let Self { out, many, few, strides } = self;
        let whole = many.rows - many.rows % BLOCK;
        for j in 0..few.rows {
            let vector = few.row(j);
            for i in (0..whole).step_by(BLOCK) {
                let rows = [many.row(i), many.row(i + 1), many.row(i + 2), many.row(i + 3)];
                for (place, value) in dot_products(rows, vector).into_iter().enumerate() {
                    out[(i + place) * strides[0] + j * strides[1]] = value;
                }
            }
            for i in whole..many.rows {
                let [value] = dot_products([many.row(i)], vector);
                out[i * strides[0] + j * strides[1]] = value;
            }
        }
    }
}

/// Product l is added to sum l mod 16 by a fused multiply-add, and the sums are added by halves.
///
/// Every index is known when this is compiled, so that the sums are vectors.
#[expect(
    clippy::inline_always,
    reason = "only what is inlined into the dispatch is compiled for the processor"
)]
#[inline(always)]
fn dot_products<const ROWS: usize>(rows: [&[f32]; ROWS], vector: &[f32]) -> [f32; ROWS] {
    let mut sums = [[0.0_f32; SUMS]; ROWS];
    let (chunks, rest) = vector.as_chunks::<SUMS>();
    for (index, chunk) in chunks.iter().enumerate() {
        for place in 0..ROWS {
            let row = &rows[place][index * SUMS..][..SUMS];
            for lane in 0..SUMS {
                sums[place][lane] = row[lane].mul_add(chunk[lane], sums[place][lane]);
            }
        }
    }
    if !rest.is_empty() {
        let vector = padded(rest);
        for place in 0..ROWS {
            let row = padded(&rows[place][chunks.len() * SUMS..]);
            for lane in 0..SUMS {
                sums[place][lane] = row[lane].mul_add(vector[lane], sums[place][lane]);
            }
        }
    }
    let mut values = [0.0; ROWS];
    for place in 0..ROWS {
        let eight: [f32; 8] = halves(&sums[place]);
        let four: [f32; 4] = halves(&eight);
        let two: [f32; 2] = halves(&four);
        values[place] = two[0] + two[1];
    }
    values
}

/// `values`, fewer than [`SUMS`], and zeros.
#[expect(clippy::inline_always, reason = "as the loops around it")]
#[inline(always)]
fn padded(values: &[f32]) -> [f32; SUMS] {
    let mut padded = [0.0; SUMS];
    padded[..values.len()].copy_from_slice(values);
    padded
}

/// The sums of the first and the second half.
#[expect(clippy::inline_always, reason = "as the loops around it")]
#[inline(always)]
fn halves<const HALF: usize>(values: &[f32]) -> [f32; HALF] {
    let mut sums = [0.0; HALF];
    for lane in 0..HALF {
        sums[lane] = values[lane] + values[lane + HALF];
    }
    sums
}

/// Each row of the result as a sum of the rows of `right`, which lie in order, one after another.
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
        out.fill(0.0);
        let (k, n) = (left.columns, right.columns);
        let whole = k - k % BLOCK;
        for (i, out) in out.chunks_exact_mut(n.max(1)).enumerate() {
            for l in (0..whole).step_by(BLOCK) {
                let rows = [right.row(l), right.row(l + 1), right.row(l + 2), right.row(l + 3)];
                let weights = [left.at(i, l), left.at(i, l + 1), left.at(i, l + 2), left.at(i, l + 3)];
                add_scaled(out, weights, rows);
            }
            for l in whole..k {
                add_scaled(out, [left.at(i, l)], [right.row(l)]);
            }
        }
    }
}

/// `out` += Σ `weights`ₗ · `rows`ₗ, one row after the other, by fused multiply-adds.
#[expect(
    clippy::inline_always,
    reason = "only what is inlined into the dispatch is compiled for the processor"
)]
#[inline(always)]
fn add_scaled<const ROWS: usize>(out: &mut [f32], weights: [f32; ROWS], rows: [&[f32]; ROWS]) {
    let rows = rows.map(|row| &row[..out.len()]);
    for (index, out) in out.iter_mut().enumerate() {
        let mut sum = *out;
        for place in 0..ROWS {
            sum = weights[place].mul_add(rows[place][index], sum);
        }
        *out = sum;
    }
}
