//! Matrix products with the same order of sums on every processor.

mod thin;

use gemm::{Parallelism, gemm};
use pulp::{Arch, NullaryFnOnce};

use crate::Matrix;

/// Maximum length of a chain of multiply-adds. The library never splits a shorter one, whatever the caches of the
/// processor.
const CHAIN: usize = 512;

/// Up to this many result values are computed as dot products, if both operands are contiguous along the inner size.
pub(crate) const FEW: usize = 256;

/// Computes `out` = `left` · `right`, with `out` as `[left.rows, right.columns]`, row after row.
///
/// Every value is a sum in an order that depends only on shapes and layouts. So all processors give the same bytes.
/// With k the inner size:
///
/// - one row or column, or at most 256 values, if both operands are contiguous along k: sixteen partial sums by fused
///   multiply-adds, product l in sum l mod 16, added by halves;
/// - otherwise fused multiply-adds one after another from 0. If neither operand is a row or column and k is above 512,
///   there are ⌈k / 512⌉ equal parts (the last one may be shorter), which are added one after another.
///
/// Uses one thread. Callers run populations and training runs in parallel, which needs no synchronisation.
///
/// # Panics
/// If the sizes do not agree.
pub fn multiply(out: &mut [f32], left: Matrix<'_>, right: Matrix<'_>) {
    let m = left.rows;
    let k = left.columns;
    let n = right.columns;
    assert_eq!(k, right.rows, "inner sizes of a product agree");
    assert_eq!(out.len(), m * n, "the result covers its values");
    if m == 0 || n == 0 {
        return;
    }
    let thin = m == 1 || n == 1;
    let along = left.column_stride == 1 && right.row_stride == 1;
    if along && (thin || m * n <= FEW) {
        thin::dots(out, left, right);
    } else if m == 1 || (k <= 2 && right.column_stride == 1) {
        thin::combine(out, left, right);
    } else if n == 1 {
        thin::combine(out, right.transposed(), left.transposed());
    } else if k <= 2 || matches!(Arch::new(), Arch::Scalar) {
        // For k ≤ 2 the library starts a sum with a product instead of 0. Without fused multiply-adds in the processor,
        // it does not fuse.
        chains(out, left, right);
    } else {
        let part = k.div_ceil(k.div_ceil(CHAIN));
        for first in (0..k).step_by(part) {
            add_part(out, left, right, first, part.min(k - first));
        }
    }
}

/// Sets `out` to the product over the inner indices `first..first + count`. Adds to `out` instead if `first` is not 0.
fn add_part(out: &mut [f32], left: Matrix<'_>, right: Matrix<'_>, first: usize, count: usize) {
    let m = left.rows;
    let n = right.columns;
    assert!(first + count <= left.columns && left.columns == right.rows && out.len() == m * n);
    let left_values = &left.values[first * left.column_stride..];
    let right_values = &right.values[first * right.row_stride..];
    // SAFETY: `Matrix::new` proved that every (i, j) of both operands lies inside their slices, and transposing keeps
    // the set of addresses. By the assertion, `count` columns of the left and rows of the right operand from `first` on
    // are among them. The assertion covers `out` too. `out` is borrowed exclusively and so overlaps neither operand. It
    // is read only where it was written before.
    unsafe {
        gemm(
            m,
            n,
            count,
            out.as_mut_ptr(),
            1,
            n as isize,
            first > 0,
            left_values.as_ptr(),
            left.column_stride as isize,
            left.row_stride as isize,
            right_values.as_ptr(),
            right.column_stride as isize,
            right.row_stride as isize,
            1.0,
            1.0,
            false,
            false,
            false,
            Parallelism::None,
        );
    }
}

/// Computes the product by definition, loop by loop: for processors without fused multiply-adds, and for degenerate
/// products.
fn chains(out: &mut [f32], left: Matrix<'_>, right: Matrix<'_>) {
    Arch::new().dispatch(Chains { out, left, right });
}

struct Chains<'a> {
    out: &'a mut [f32],
    left: Matrix<'a>,
    right: Matrix<'a>,
}

impl NullaryFnOnce for Chains<'_> {
    type Output = ();

    #[expect(
        clippy::inline_always,
        reason = "only what is inlined into the dispatch is compiled for the processor"
    )]
    #[inline(always)]
    fn call(self) {
        let Self { out, left, right } = self;
        let k = left.columns;
        let part = k.div_ceil(k.div_ceil(CHAIN).max(1)).max(1);
        for (i, row) in out.chunks_exact_mut(right.columns).enumerate() {
            for (j, out) in row.iter_mut().enumerate() {
                *out = 0.0;
                for first in (0..k).step_by(part) {
                    let mut sum = 0.0;
                    for l in first..k.min(first + part) {
                        sum = left.at(i, l).mul_add(right.at(l, j), sum);
                    }
                    *out = if first == 0 { sum } else { *out + sum };
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
