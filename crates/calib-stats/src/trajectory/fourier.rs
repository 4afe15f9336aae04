//! A fast Fourier transform for powers of two.

use std::f64::consts::TAU;

/// Returns squared magnitudes of the discrete Fourier transform of real `values`, at frequencies
/// 0 … n/2 cycles per n samples. n must be a power of two.
pub(super) fn power(values: &[f64]) -> Vec<f64> {
    let n = values.len();
    assert!(n.is_power_of_two(), "the transform is for powers of two, got {n}");
    let mut re = values.to_vec();
    let mut im = vec![0.0; n];
    for from in 0..n {
        let to = reversed(from, n.trailing_zeros());
        if from < to {
            re.swap(from, to);
        }
    }
    let mut half = 1;
    while half < n {
        for pair in 0..half {
            let (sin, cos) = (-TAU * pair as f64 / (2 * half) as f64).sin_cos();
            for low in (pair..n).step_by(2 * half) {
                let high = low + half;
                let a = re[high] * cos - im[high] * sin;
                let b = re[high] * sin + im[high] * cos;
                (re[high], im[high]) = (re[low] - a, im[low] - b);
                (re[low], im[low]) = (re[low] + a, im[low] + b);
            }
        }
        half *= 2;
    }
    re.iter().zip(&im).take(n / 2 + 1).map(|(re, im)| re * re + im * im).collect()
}

/// Returns `index` with its lowest `bits` bits in reverse order.
fn reversed(index: usize, bits: u32) -> usize {
    if bits == 0 { index } else { index.reverse_bits() >> (usize::BITS - bits) }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn by_definition(values: &[f64]) -> Vec<f64> {
        let n = values.len();
        let term = |k: usize, f: fn(f64) -> f64| -> f64 {
            let terms = values.iter().enumerate().map(|(t, value)| {
                let angle = TAU * ((k * t) % n) as f64 / n as f64;
                value * f(angle)
            });
            terms.sum()
        };
        (0..=n / 2).map(|k| term(k, f64::cos).powi(2) + term(k, f64::sin).powi(2)).collect()
    }

    proptest! {
        #[test]
        fn it_is_the_transform(bits in 0..7_u32, seed in proptest::collection::vec(-1.0..1.0, 64)) {
            let values = &seed[..1 << bits];
            let (fast, slow) = (power(values), by_definition(values));
            prop_assert_eq!(fast.len(), slow.len());
            for (fast, slow) in fast.iter().zip(&slow) {
                prop_assert!((fast - slow).abs() < 1e-10 * (1.0 + slow));
            }
        }
    }
}
