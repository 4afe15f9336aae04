use std::f64::consts::TAU;

use super::{check_finite, fourier::power};
use crate::{StatsError, mean};

/// Added to every power before the logarithm, in squared units of the series per sample. A frequency
/// without any power counts as having this power.
///
/// On a sensor normalised to 0 … 1 this is an oscillation of a millionth of the range. Our choice.
pub const SPECTRUM_FLOOR: f64 = 1e-12;

/// Returns the power spectrum of `values` `[n]` in segments of `segment` samples: `[segment / 2]`, at
/// the frequencies 1 … segment / 2 cycles per segment.
///
/// Welch's method: segments overlap by half, and each is centred and multiplied by a Hann window. The
/// result is the mean of their periodograms `|Σ w_t x_t e^{−2πikt/L}|² / Σ w_t²`. White noise of
/// variance σ² has σ² everywhere. Source: Welch, *The use of fast Fourier transform for the estimation
/// of power spectra*, 1967.
///
/// # Errors
///
/// `values` is shorter than a segment, or holds NaN or an infinity; `segment` is no power of two, or
/// less than 4.
pub fn spectrum(values: &[f64], segment: usize) -> Result<Vec<f64>, StatsError> {
    check_finite("values", values)?;
    if segment < 4 || !segment.is_power_of_two() {
        return Err(StatsError::Segment { got: segment });
    }
    if values.len() < segment {
        return Err(StatsError::TooShort { what: "values", expected: segment, got: values.len() });
    }
    let window: Vec<f64> =
        (0..segment).map(|t| 0.5 - 0.5 * (TAU * t as f64 / segment as f64).cos()).collect();
    let squares: f64 = window.iter().map(|weight| weight * weight).sum();
    let mut sum = vec![0.0; segment / 2];
    let mut count = 0;
    for start in (0..=values.len() - segment).step_by(segment / 2) {
        let piece = &values[start..start + segment];
        let mean = mean(piece)?;
        let windowed: Vec<f64> =
            piece.iter().zip(&window).map(|(value, weight)| weight * (value - mean)).collect();
        for (sum, power) in sum.iter_mut().zip(&power(&windowed)[1..]) {
            *sum += power;
        }
        count += 1;
    }
    Ok(sum.into_iter().map(|sum| sum / (f64::from(count) * squares)).collect())
}

/// Returns the distance between the power spectra of two series `x` and `y`, in decibels: the root
/// mean square over the frequencies of [`spectrum`] of the difference of the log powers, 10 log₁₀(P +
/// [`SPECTRUM_FLOOR`]).
///
/// 0 for equal spectra; a factor c between the series gives 20 log₁₀ c. Two stretches of the same
/// random process differ by some decibels, because spectra are estimates. Source: the log-spectral
/// distance of Gray and Markel, *Distance measures for speech processing*, 1976; Welch's estimate and
/// the floor are our choice.
///
/// # Errors
///
/// As [`spectrum`], for either series.
///
/// ```
/// let x: Vec<f64> = (0..64_u16).map(|t| (f64::from(t) * 0.9).sin()).collect();
/// let louder: Vec<f64> = x.iter().map(|value| 10.0 * value).collect();
/// assert_eq!(calib_stats::spectral_distance(&x, &x, 16)?, 0.0);
/// assert!((calib_stats::spectral_distance(&x, &louder, 16)? - 20.0).abs() < 1e-3);
/// # Ok::<(), calib_stats::StatsError>(())
/// ```
pub fn spectral_distance(x: &[f64], y: &[f64], segment: usize) -> Result<f64, StatsError> {
    let x = spectrum(x, segment)?;
    let y = spectrum(y, segment)?;
    let squares: f64 = x.iter().zip(&y).map(|(x, y)| (decibels(*x) - decibels(*y)).powi(2)).sum();
    Ok((squares / x.len() as f64).sqrt())
}

fn decibels(power: f64) -> f64 {
    10.0 * (power + SPECTRUM_FLOOR).log10()
}

/// Returns the usual length of a segment for series of `len` values: the largest power of two up to a
/// quarter of it, at most 256. Our choice: it gives at least seven segments to average over.
///
/// `None` for series of less than 16 values, which are too short for a spectrum.
pub fn usual_segment(len: usize) -> Option<usize> {
    let quarter = (len / 4).min(256);
    (quarter >= 4).then(|| 1 << quarter.ilog2())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_sine_has_its_power_at_its_frequency() {
        let x: Vec<f64> = (0..256_u16).map(|t| (TAU * 5.0 * f64::from(t) / 32.0).sin()).collect();
        let power = spectrum(&x, 32).unwrap();
        assert_eq!(power.len(), 16);
        // With a Hann window an amplitude of 1 gives (Σw / 2)² / Σw² = L / 6 at its own frequency.
        assert!((power[4] - 32.0 / 6.0).abs() < 1e-9, "{power:?}");
        assert!(power.iter().enumerate().all(|(k, &p)| (3..=5).contains(&k) || p < 1e-20));
    }

    #[test]
    fn a_constant_series_has_no_power_and_a_finite_distance() {
        assert!(spectrum(&[0.25; 40], 16).unwrap().iter().all(|&power| power == 0.0));
        assert_eq!(spectral_distance(&[0.25; 40], &[0.75; 40], 16).unwrap(), 0.0);
        let noisy: Vec<f64> = (0..40_u8).map(|t| f64::from(t % 3)).collect();
        assert!(spectral_distance(&[0.25; 40], &noisy, 16).unwrap().is_finite());
    }

    #[test]
    fn what_has_no_spectrum_is_refused() {
        assert_eq!(spectrum(&[1.0; 40], 12), Err(StatsError::Segment { got: 12 }));
        assert_eq!(spectrum(&[1.0; 40], 2), Err(StatsError::Segment { got: 2 }));
        let short = StatsError::TooShort { what: "values", expected: 64, got: 40 };
        assert_eq!(spectrum(&[1.0; 40], 64), Err(short));
        assert_eq!(
            (usual_segment(15), usual_segment(16), usual_segment(3000)),
            (None, Some(4), Some(256))
        );
    }

    fn distance(x: &[f64], y: &[f64]) -> f64 {
        spectral_distance(x, y, 8).unwrap()
    }

    proptest! {
        #[test]
        fn it_is_symmetric_and_satisfies_the_triangle_inequality(
            x in proptest::collection::vec(-1.0..1.0, 40..60),
            y in proptest::collection::vec(-1.0..1.0, 40..60),
            z in proptest::collection::vec(-1.0..1.0, 40..60),
        ) {
            prop_assert_eq!(distance(&x, &y), distance(&y, &x));
            prop_assert!(distance(&x, &z) <= distance(&x, &y) + distance(&y, &z) + 1e-9);
        }

        #[test]
        fn the_power_over_all_frequencies_is_the_variance_of_white_noise(
            x in proptest::collection::vec(-1.0..1.0, 4096..4097),
        ) {
            let variance = x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64;
            let power = spectrum(&x, 64).unwrap();
            let mean = power.iter().sum::<f64>() / power.len() as f64;
            prop_assert!((mean / variance - 1.0).abs() < 0.15, "{} {}", mean, variance);
        }
    }
}
