//! The linear algebra behind embeddings and principal components.

use calib_core::Seed;
use rayon::prelude::*;

/// Rounds of subspace iteration. The axes need not have converged.
const ROUNDS: usize = 12;

/// Rows of the covariance that one task computes.
const BAND: usize = 16;

/// Returns the mean of some states, in f64.
pub(crate) fn mean(sample: &[&[f32]], columns: usize) -> Vec<f64> {
    let mut mean = vec![0.0; columns];
    for state in sample {
        for (sum, &value) in mean.iter_mut().zip(*state) {
            *sum += f64::from(value);
        }
    }
    for sum in &mut mean {
        *sum /= sample.len().max(1) as f64;
    }
    mean
}

/// Returns the mean and covariance `[columns, columns]` of some states, in f64.
///
/// Takes `8 columns²` bytes, and `8 · 17 · columns` bytes per thread.
pub(crate) fn covariance(sample: &[&[f32]], columns: usize) -> (Vec<f64>, Vec<f64>) {
    let count = sample.len().max(1) as f64;
    let mean = mean(sample, columns);
    // Each task computes some of the rows, from the diagonal on, and adds the states in order. So the result does not depend on
    // the number of threads.
    let mut total = vec![0.0; columns * columns];
    total.par_chunks_mut(BAND * columns.max(1)).enumerate().for_each(|(band, total)| {
        let first = band * BAND;
        let mut part = vec![0.0; total.len()];
        let mut centred = vec![0.0; columns];
        for chunk in sample.chunks(1024) {
            part.fill(0.0);
            for state in chunk {
                let values = state.iter().zip(&mean).skip(first);
                for (centred, (&value, mean)) in centred[first..].iter_mut().zip(values) {
                    *centred = f64::from(value) - mean;
                }
                for (row, part) in (first..).zip(part.chunks_exact_mut(columns)) {
                    let a = centred[row];
                    let part = &mut part[row..];
                    for (sum, &b) in part.iter_mut().zip(&centred[row..]) {
                        *sum += a * b;
                    }
                }
            }
            for (total, part) in total.iter_mut().zip(&part) {
                *total += part / count;
            }
        }
    });
    for row in 1..columns {
        for column in 0..row {
            total[row * columns + column] = total[column * columns + row];
        }
    }
    (mean, total)
}

/// Approximates the `count` eigenvectors of the largest eigenvalues, as `[columns, count]`, by subspace iteration from a fixed
/// start. They are orthonormal up to rounding.
pub(crate) fn leading_axes(
    covariance: &[f64],
    columns: usize,
    count: usize,
    seed: Seed,
) -> Vec<f64> {
    let mut rng = seed.rng();
    // The axes are stored as rows, which is the convenient order here.
    let mut axes: Vec<Vec<f64>> =
        (0..count).map(|_| (0..columns).map(|_| rng.normal()).collect()).collect();
    orthonormalise(&mut axes, &mut rng);
    for _ in 0..ROUNDS {
        // Row by row, so that a large matrix is read once for all axes.
        let products: Vec<Vec<f64>> = covariance
            .par_chunks_exact(columns)
            .map(|row| axes.iter().map(|axis| dot(row, axis)).collect())
            .collect();
        for (number, axis) in axes.iter_mut().enumerate() {
            for (value, products) in axis.iter_mut().zip(&products) {
                *value = products[number];
            }
        }
        orthonormalise(&mut axes, &mut rng);
    }
    let mut transposed = vec![0.0; columns * count];
    for (number, axis) in axes.iter().enumerate() {
        for (column, &value) in axis.iter().enumerate() {
            transposed[column * count + number] = value;
        }
    }
    transposed
}

fn scale(axis: &mut [f64], factor: f64) {
    for value in axis {
        *value *= factor;
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Orthonormalises the axes by Gram–Schmidt, each axis twice against all before it ("twice is enough", Giraud et al. 2005).
/// Replaces an axis that vanishes by a random one.
fn orthonormalise(axes: &mut [Vec<f64>], rng: &mut calib_core::Rng) {
    for current in 0..axes.len() {
        let (before, rest) = axes.split_at_mut(current);
        let axis = &mut rest[0];
        loop {
            let length = dot(axis, axis).sqrt();
            if length > 0.0 {
                scale(axis, 1.0 / length);
            }
            for _ in 0..2 {
                for other in &*before {
                    let share = dot(axis, other);
                    for (value, other) in axis.iter_mut().zip(other) {
                        *value -= share * other;
                    }
                }
            }
            let length = dot(axis, axis).sqrt();
            // Where little is left, one more round removes what rounding brought back.
            if length > 0.5 {
                scale(axis, 1.0 / length);
                break;
            }
            if length < 1e-6 {
                for value in axis.iter_mut() {
                    *value = rng.normal();
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_orthonormal_and_lead() {
        // The axes of the covariance diag(1, 1/4, 1/9, …) in rotated coordinates are found as its leading axes.
        let columns = 20;
        let mut covariance = vec![0.0; columns * columns];
        for i in 0..columns {
            covariance[i * columns + i] = 0.3_f64.powi(i as i32);
        }
        let count = 6;
        let axes = leading_axes(&covariance, columns, count, Seed::new(1));
        for a in 0..count {
            for b in 0..count {
                let product: f64 =
                    (0..columns).map(|c| axes[c * count + a] * axes[c * count + b]).sum();
                assert!((product - f64::from(u8::from(a == b))).abs() < 1e-14);
            }
        }
        for c in 0..count {
            let inside: f64 = (0..count).map(|a| axes[c * count + a].powi(2)).sum();
            assert!(inside > 0.999, "column {c}: {inside}");
        }
    }

    #[test]
    fn no_variance_still_gives_orthonormal_axes() {
        let axes = leading_axes(&[0.0; 9], 3, 3, Seed::new(1));
        for a in 0..3 {
            let length: f64 = (0..3).map(|c| axes[c * 3 + a].powi(2)).sum();
            assert!((length - 1.0).abs() < 1e-14);
        }
    }

    #[test]
    fn covariance_of_many_states_is_the_sum_of_products() {
        let rows = 2500;
        let columns = 2 * BAND + 5;
        let mut rng = Seed::new(3).rng();
        let values: Vec<f32> = (0..rows * columns).map(|_| rng.normal() as f32).collect();
        let sample: Vec<&[f32]> = values.chunks(columns).collect();
        let [one, four] = [1, 4].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.expect("a pool").install(|| covariance(&sample, columns))
        });
        assert_eq!(one, four);
        let (mean, all) = one;
        for a in 0..columns {
            for b in 0..columns {
                let products = sample
                    .iter()
                    .map(|state| (f64::from(state[a]) - mean[a]) * (f64::from(state[b]) - mean[b]));
                let expected = products.sum::<f64>() / rows as f64;
                assert!((all[a * columns + b] - expected).abs() < 1e-12, "{a} {b}");
            }
        }
    }
}
