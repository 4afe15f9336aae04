//! Principal components, for searches in fewer dimensions.

use calib_core::{Monitor, Seed, States};
use rayon::prelude::*;

use crate::{
    KnnError,
    index::{covariance, leading_axes},
};

/// Maximum number of rows from which the axes are estimated.
const SAMPLE: usize = 16_384;
/// Rows between two checks for an interruption.
const CHUNK: usize = 1 << 12;

/// Returns the first `count` principal components of `states`, `[n, count]`: `A(x − μ)`.
///
/// Mean and axes come from at most 16,384 evenly spread rows. Sums are computed in f64, in column order and without fused
/// multiplication, so that every machine gives the same result. Progress counts rows.
///
/// # Errors
/// If there are not more than `count` columns, or the monitor interrupts.
pub(crate) fn leading_components(
    states: &States,
    count: usize,
    monitor: &dyn Monitor,
) -> Result<States, KnnError> {
    let rows = states.rows();
    let columns = states.columns();
    if count >= columns {
        return Err(KnnError::Components { components: count, columns });
    }
    monitor.begin("principal components", rows as u64);
    let stride = rows.div_ceil(SAMPLE).max(1);
    let sample: Vec<&[f32]> = (0..rows).step_by(stride).map(|row| states.row(row)).collect();
    let (mean, covariance) = covariance(&sample, columns);
    let axes = leading_axes(&covariance, columns, count, Seed::new(0));
    let mut values = vec![0.0_f32; rows * count];
    values.par_chunks_mut(CHUNK * count).enumerate().for_each(|(number, chunk)| {
        if monitor.interrupted() {
            return;
        }
        let mut sums = vec![0.0_f64; count];
        for (row, out) in (number * CHUNK..).zip(chunk.chunks_exact_mut(count)) {
            sums.fill(0.0);
            let columns = states.row(row).iter().zip(&mean).zip(axes.chunks_exact(count));
            for ((&value, mean), axes) in columns {
                let centred = f64::from(value) - mean;
                for (sum, axis) in sums.iter_mut().zip(axes) {
                    *sum += centred * axis;
                }
            }
            for (out, &sum) in out.iter_mut().zip(&sums) {
                *out = (sum as f32).clamp(f32::MIN, f32::MAX);
            }
        }
        monitor.advance((chunk.len() / count) as u64);
    });
    monitor.check()?;
    let components = States::new(values, rows, count);
    Ok(components.unwrap_or_else(|_| unreachable!("components are finite")))
}

#[cfg(test)]
mod tests {
    use calib_core::Silent;

    use super::*;
    use crate::distance::squared;

    #[test]
    fn components_keep_the_distances_that_vary() {
        let rows = 300;
        let columns = 20;
        let mut rng = Seed::new(2).rng();
        let loadings: Vec<f64> = (0..3 * columns).map(|_| rng.normal()).collect();
        let mut values = Vec::new();
        for _ in 0..rows {
            let factors = [rng.normal(), rng.normal(), rng.normal()];
            for column in 0..columns {
                let mixed: f64 = (0..3).map(|f| factors[f] * loadings[f * columns + column]).sum();
                values.push((5.0 + mixed) as f32);
            }
        }
        let states = States::new(values, rows, columns).expect("finite");
        let three = leading_components(&states, 3, &Silent).expect("fewer than columns");
        assert_eq!((three.rows(), three.columns()), (rows, 3));
        for a in 0..rows {
            let full = squared(states.row(0), states.row(a));
            let reduced = squared(three.row(0), three.row(a));
            assert!((full - reduced).abs() <= 1e-4 * (1.0 + full), "{full} {reduced}");
        }
        let error = leading_components(&states, 20, &Silent).expect_err("all columns");
        assert!(error.to_string().contains("fewer than the 20 columns"), "{error}");
    }
}
