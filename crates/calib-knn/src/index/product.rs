use gemm::{Parallelism, gemm};

/// `out[i, j] = Σ_c left[i, c] · right[j, c]`: inner products of the rows of two matrices with `columns` columns.
///
/// One thread: blocks of queries are parallel outside.
pub(super) fn inner_products(out: &mut [f32], left: &[f32], right: &[f32], columns: usize) {
    let (m, n) = (left.len() / columns, right.len() / columns);
    assert_eq!(left.len(), m * columns, "the left matrix has whole rows");
    assert_eq!(right.len(), n * columns, "the right matrix has whole rows");
    assert_eq!(out.len(), m * n, "there is a place for every pair of rows");
    // SAFETY: the assertions prove that every (i, c) of both operands and every (i, j) of the result lies
    // inside its slice; `out` is borrowed exclusively, so it overlaps neither operand. `read_dst` is
    // false: `out` is only written.
    #[expect(unsafe_code, reason = "the GEMM library takes pointers")]
    unsafe {
        gemm(
            m,
            n,
            columns,
            out.as_mut_ptr(),
            1,
            n as isize,
            false,
            left.as_ptr(),
            1,
            columns as isize,
            right.as_ptr(),
            columns as isize,
            1,
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
    use super::*;

    #[test]
    fn products_are_the_definition() {
        for (m, n, columns) in [(1, 1, 1), (3, 5, 7), (64, 33, 142), (17, 129, 2)] {
            let values = |rows: usize, salt: usize| -> Vec<f32> {
                (0..rows * columns).map(|i| ((i * 37 + salt) % 19) as f32 - 9.0).collect()
            };
            let (left, right) = (values(m, 1), values(n, 5));
            let mut out = vec![f32::NAN; m * n];
            inner_products(&mut out, &left, &right, columns);
            for (i, a) in left.chunks(columns).enumerate() {
                for (j, b) in right.chunks(columns).enumerate() {
                    // Small integers: exact in f32.
                    let expected: f32 = a.iter().zip(b).map(|(a, b)| a * b).sum();
                    assert_eq!(out[i * n + j], expected);
                }
            }
        }
    }
}
