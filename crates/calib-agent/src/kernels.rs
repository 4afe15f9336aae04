//! Dot products and sums for linear value functions, with the widest vectors that the processor has.
//!
//! A dot product consists of 16 partial sums, whatever the vector width: product i is added to sum i
//! mod 16 by a fused multiply-add, and the partial sums are then added pairwise by halves. Results
//! therefore depend neither on the processor nor on how many agents or transitions share a pass.
//!
//! The code uses loops, not iterator closures: a closure that is not inlined is compiled without
//! vectors.

#![expect(
    clippy::inline_always,
    reason = "only what is inlined into the dispatch is compiled for the processor"
)]

use pulp::Simd;

/// Number of partial sums. Vectors are padded with zeros to a multiple of this length.
pub(crate) const LANES: usize = 16;

/// Returns the dot product of each of `rows` with `weights`. All have one length, a multiple of
/// [`LANES`].
#[inline(always)]
pub(crate) fn dot_products<S: Simd, const ROWS: usize>(
    simd: S,
    rows: [&[f32]; ROWS],
    weights: &[f32],
) -> [f32; ROWS] {
    let vectors = const { LANES / S::F32_LANES };
    let weights = S::as_simd_f32s(weights).0;
    let rows = rows.map(|row| &S::as_simd_f32s(row).0[..weights.len()]);
    let mut sums = [[simd.splat_f32s(0.0); LANES]; ROWS];
    for start in (0..weights.len() / vectors).map(|chunk| chunk * vectors) {
        for vector in 0..vectors {
            let weight = weights[start + vector];
            for (sums, row) in sums.iter_mut().zip(rows) {
                let sum = sums[vector];
                sums[vector] = simd.mul_add_f32s(row[start + vector], weight, sum);
            }
        }
    }
    let mut totals = [0.0; ROWS];
    for (total, sums) in totals.iter_mut().zip(&mut sums) {
        let mut half = vectors / 2;
        while half > 0 {
            for vector in 0..half {
                sums[vector] = simd.add_f32s(sums[vector], sums[vector + half]);
            }
            half /= 2;
        }
        *total = simd.reduce_sum_f32s(sums[0]);
    }
    totals
}

/// Adds Σ `scales`ᵢ · `rows`ᵢ to `sum`, one row after the other, by fused multiply-adds.
#[inline(always)]
pub(crate) fn add_scaled<S: Simd, const ROWS: usize>(
    simd: S,
    sum: &mut [f32],
    scales: [f32; ROWS],
    rows: [&[f32]; ROWS],
) {
    let sum = S::as_mut_simd_f32s(sum).0;
    let rows = rows.map(|row| &S::as_simd_f32s(row).0[..sum.len()]);
    let mut factors = [simd.splat_f32s(0.0); ROWS];
    for (factor, scale) in factors.iter_mut().zip(scales) {
        *factor = simd.splat_f32s(scale);
    }
    for (index, sum) in sum.iter_mut().enumerate() {
        let mut value = *sum;
        for (factor, row) in factors.into_iter().zip(rows) {
            value = simd.mul_add_f32s(factor, row[index], value);
        }
        *sum = value;
    }
}

#[cfg(test)]
mod tests {
    use pulp::{Arch, Scalar, WithSimd};

    use super::*;

    const LENGTH: usize = 48;

    struct Both<'a> {
        rows: [&'a [f32]; 3],
        weights: &'a [f32],
    }

    impl WithSimd for Both<'_> {
        type Output = ([f32; 3], Vec<f32>);

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
            let mut sum = self.weights.to_vec();
            add_scaled(simd, &mut sum, [-2.0, 0.5, 0.1], self.rows);
            (dot_products(simd, self.rows, self.weights), sum)
        }
    }

    fn operand(salt: usize, scale: f32) -> Vec<f32> {
        (0..LENGTH).map(|i| ((i * 31 + salt * 17) % 23) as f32 * scale - 8.0).collect()
    }

    #[test]
    fn results_are_those_of_the_definition_on_every_processor() {
        for scale in [1.0, 0.37] {
            let rows = [operand(1, scale), operand(2, scale), operand(3, scale)];
            let weights = operand(4, scale);
            let [fast, plain] =
                [(); 2].map(|()| Both { rows: [&rows[0], &rows[1], &rows[2]], weights: &weights });
            let (dots, sum) = Arch::new().dispatch(fast);
            assert_eq!((dots, sum.clone()), plain.with_simd(Scalar), "to the byte");
            for (row, dot) in rows.iter().zip(dots) {
                let products = row.iter().zip(&weights).map(|(&x, &w)| f64::from(x) * f64::from(w));
                let expected = products.sum::<f64>();
                assert!((f64::from(dot) - expected).abs() < 1e-2, "{dot} {expected}");
            }
            for (i, got) in sum.iter().enumerate() {
                let expected = weights[i] - 2.0 * rows[0][i] + 0.5 * rows[1][i] + 0.1 * rows[2][i];
                assert!((got - expected).abs() < 1e-4, "{got} {expected}");
            }
        }
    }
}
