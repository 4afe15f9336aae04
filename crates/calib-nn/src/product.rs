use gemm::{Parallelism, gemm};

/// A matrix over borrowed values: element (i, j) is `values[i * row_stride + j * column_stride]`.
#[derive(Clone, Copy, Debug)]
pub struct Matrix<'a> {
    values: &'a [f32],
    rows: usize,
    columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a> Matrix<'a> {
    /// `values` as `[rows, columns]`, row after row.
    ///
    /// # Panics
    /// If there are not as many values.
    pub fn new(values: &'a [f32], rows: usize, columns: usize) -> Self {
        assert_eq!(values.len(), rows * columns, "a matrix covers its values");
        Self { values, rows, columns, row_stride: columns, column_stride: 1 }
    }

    /// The transpose, over the same values.
    #[must_use]
    pub fn transposed(self) -> Self {
        Self {
            rows: self.columns,
            columns: self.rows,
            row_stride: self.column_stride,
            column_stride: self.row_stride,
            ..self
        }
    }
}

/// `out` = `left` · `right`, with `out` as `[left.rows, right.columns]`, row after row.
///
/// One thread: populations and runs are parallel outside, where nothing must be synchronised.
///
/// # Panics
/// If the sizes do not agree.
pub fn multiply(out: &mut [f32], left: Matrix<'_>, right: Matrix<'_>) {
    let (m, k, n) = (left.rows, left.columns, right.columns);
    assert_eq!(k, right.rows, "inner sizes of a product agree");
    assert_eq!(out.len(), m * n, "the result covers its values");
    // SAFETY: `Matrix::new` proved that every (i, j) of both operands lies inside their slices, and
    // transposing keeps the set of addresses; the second assertion does the same for `out`, which is
    // borrowed exclusively and so overlaps neither operand. `read_dst` is false: `out` is only written.
    unsafe {
        gemm(
            m,
            n,
            k,
            out.as_mut_ptr(),
            1,
            n as isize,
            false,
            left.values.as_ptr(),
            left.column_stride as isize,
            left.row_stride as isize,
            right.values.as_ptr(),
            right.column_stride as isize,
            right.row_stride as isize,
            0.0,
            1.0,
            false,
            false,
            false,
            Parallelism::None,
        );
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn operand(rows: usize, columns: usize, salt: usize) -> Vec<f32> {
        (0..rows * columns).map(|i| ((i * 37 + salt * 11) % 19) as f32 - 9.0).collect()
    }

    proptest! {
        #[test]
        fn every_layout_agrees_with_the_definition(m in 1_usize..70, k in 1_usize..70, n in 1_usize..70) {
            let (a, b) = (operand(m, k, 1), operand(k, n, 2));
            let (at, bt) = (operand(k, m, 3), operand(n, k, 4));
            for left in [Matrix::new(&a, m, k), Matrix::new(&at, k, m).transposed()] {
                for right in [Matrix::new(&b, k, n), Matrix::new(&bt, n, k).transposed()] {
                    let at = |x: &Matrix<'_>, i: usize, j: usize| {
                        x.values[i * x.row_stride + j * x.column_stride]
                    };
                    let mut out = vec![f32::NAN; m * n];
                    multiply(&mut out, left, right);
                    for i in 0..m {
                        for j in 0..n {
                            // Small integers: exact in any order of summation.
                            let expected: f32 = (0..k).map(|l| at(&left, i, l) * at(&right, l, j)).sum();
                            prop_assert_eq!(out[i * n + j], expected);
                        }
                    }
                }
            }
        }
    }
}
