use calib_core::Seed;
use proptest::prelude::*;

use super::*;

/// Returns small integers, which are exact in any order of summation.
fn integers(rows: usize, columns: usize, salt: usize) -> Vec<f32> {
    (0..rows * columns).map(|i| ((i * 37 + salt * 11) % 19) as f32 - 9.0).collect()
}

fn numbers(count: usize, seed: u64) -> Vec<f32> {
    let mut rng = Seed::new(seed).rng();
    (0..count).map(|_| rng.uniform(-1.0, 1.0) as f32).collect()
}

/// Returns both layouts of a matrix of these values.
fn layouts(values: &[f32], rows: usize, columns: usize) -> [Matrix<'_>; 2] {
    [Matrix::new(values, rows, columns), Matrix::new(values, columns, rows).transposed()]
}

fn product(left: Matrix<'_>, right: Matrix<'_>) -> Vec<f32> {
    let mut out = vec![f32::NAN; left.rows * right.columns];
    multiply(&mut out, left, right);
    out
}

/// Computes each value in the documented order of sums, on any processor.
fn promised(left: Matrix<'_>, right: Matrix<'_>) -> Vec<f32> {
    let places = (0..left.rows).flat_map(|i| (0..right.columns).map(move |j| (i, j)));
    places.map(|(i, j)| promised_value(left, right, i, j)).collect()
}

fn promised_value(left: Matrix<'_>, right: Matrix<'_>, i: usize, j: usize) -> f32 {
    let m = left.rows;
    let k = left.columns;
    let n = right.columns;
    let thin = m == 1 || n == 1;
    if left.column_stride == 1 && right.row_stride == 1 && (thin || m * n <= 256) {
        let mut sums: Vec<f32> =
            (0..16).map(|lane| promised_sum(left, right, [i, j], (lane..k).step_by(16))).collect();
        while sums.len() > 1 {
            let half = sums.split_off(sums.len() / 2);
            sums.iter_mut().zip(half).for_each(|(sum, other)| *sum += other);
        }
        return sums[0];
    }
    let part = if thin { k } else { k.div_ceil(k.div_ceil(512)) };
    let parts = (0..k)
        .step_by(part)
        .map(|first| promised_sum(left, right, [i, j], first..k.min(first + part)));
    parts.reduce(|sum, part| sum + part).unwrap_or(0.0)
}

/// Adds the products at these inner indices, one after the other.
fn promised_sum(
    left: Matrix<'_>,
    right: Matrix<'_>,
    [row, column]: [usize; 2],
    inner: impl Iterator<Item = usize>,
) -> f32 {
    inner.fold(0.0, |sum: f32, l| left.at(row, l).mul_add(right.at(l, column), sum))
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}

/// Checks every layout of both operands, byte by byte.
fn assert_promised(m: usize, k: usize, n: usize) {
    let a = numbers(m * k, 1);
    let b = numbers(k * n, 2);
    for left in layouts(&a, m, k) {
        for right in layouts(&b, k, n) {
            let got = product(left, right);
            let expected = promised(left, right);
            let strides = (left.column_stride, right.row_stride);
            assert_eq!(bits(&got), bits(&expected), "{m} x {k} x {n}, strides {strides:?}");
        }
    }
}

proptest! {
    #[test]
    fn every_layout_agrees_with_the_definition(m in 1_usize..70, k in 1_usize..70, n in 1_usize..70) {
        let (a, b) = (integers(m, k, 1), integers(k, n, 2));
        for left in layouts(&a, m, k) {
            for right in layouts(&b, k, n) {
                let out = product(left, right);
                for i in 0..m {
                    for j in 0..n {
                        let expected: f32 = (0..k).map(|l| left.at(i, l) * right.at(l, j)).sum();
                        prop_assert_eq!(out[i * n + j], expected);
                    }
                }
            }
        }
    }

    #[test]
    fn sums_are_in_the_promised_order(m in 1_usize..40, k in 1_usize..100, n in 1_usize..40) {
        assert_promised(m, k, n);
    }

    #[test]
    fn rows_and_columns_are_summed_in_the_promised_order(m in 1_usize..520, k in 1_usize..300) {
        assert_promised(m, k, 1);
        assert_promised(1, k, m);
    }
}

#[test]
fn long_sums_are_in_the_promised_order() {
    for k in [511, 512, 513, 768, 1000, 1024, 1025, 2500, 4096, 16_384] {
        assert_promised(1, k, 1);
        assert_promised(3, k, 2);
        assert_promised(17, k, 33);
        assert_promised(70, k, 5);
        assert_promised(1, k, 20);
    }
}

#[test]
fn batches_of_all_sizes_are_in_the_promised_order() {
    for rows in [1, 2, 3, 15, 16, 17, 63, 64, 65, 129, 256, 511, 512, 513] {
        // Forward pass, weights and errors, of a wide and of a narrow layer.
        for (inputs, outputs) in [(142, 64), (24, 16), (16, 16), (33, 1)] {
            assert_promised(rows, inputs, outputs);
            assert_promised(inputs, rows, outputs);
            assert_promised(rows, outputs, inputs);
        }
    }
}

#[test]
fn an_empty_sum_is_zero() {
    assert_eq!(product(Matrix::new(&[], 3, 0), Matrix::new(&[], 0, 2)), [0.0; 6]);
    assert_eq!(product(Matrix::new(&[], 1, 0), Matrix::new(&[], 0, 2)), [0.0; 2]);
}

#[test]
fn the_definition_is_what_the_library_computes() {
    for (m, k, n) in [(40, 30, 20), (70, 700, 17), (1, 5, 3), (5, 2, 4)] {
        let a = numbers(m * k, 3);
        let b = numbers(k * n, 4);
        let left = Matrix::new(&a, m, k);
        let right = Matrix::new(&b, k, n);
        if m > 1 {
            let mut out = vec![f32::NAN; m * n];
            chains(&mut out, left, right);
            assert_eq!(bits(&out), bits(&product(left, right)), "{m} x {k} x {n}");
        }
    }
}
