use super::check_finite;
use crate::{StatsError, mean};

/// Returns the autocorrelations of `values` `[n]` at the lags 1 to `lags`. Beyond n − 1 they are 0.
///
/// `ρ(k) = Σ (x_t − x̄)(x_{t+k} − x̄) / Σ (x_t − x̄)²`. `None` for a constant series, where it is not
/// defined. Source: Box and Jenkins, *Time Series Analysis*, 1976.
///
/// # Errors
///
/// `values` is empty, or holds NaN or an infinity.
pub fn autocorrelation(values: &[f64], lags: usize) -> Result<Option<Vec<f64>>, StatsError> {
    check_finite("values", values)?;
    let mean = mean(values)?;
    let centred: Vec<f64> = values.iter().map(|value| value - mean).collect();
    let variance = product(&centred, 0);
    // Rounding of the mean gives a constant series a tiny variance.
    let largest = values.iter().fold(0.0, |largest, value| f64::max(largest, value.abs()));
    if variance <= values.len() as f64 * (8.0 * f64::EPSILON * largest).powi(2) {
        return Ok(None);
    }
    Ok(Some((1..=lags).map(|lag| product(&centred, lag) / variance).collect()))
}

/// Returns the sum of the products of values with those that are `lag` later.
fn product(values: &[f64], lag: usize) -> f64 {
    let later = values.get(lag..).unwrap_or_default();
    values.iter().zip(later).map(|(now, later)| now * later).sum()
}

/// Returns the distance between the autocorrelations of two series `x` `[n]` and `y` `[m]`: the root mean
/// square of `ρ_x(k) − ρ_y(k)` over the lags k = 1 … `lags`.
///
/// 0 for equal autocorrelations; it cannot exceed 2. `None` if either series is constant, or `lags` is 0.
/// Source: Galeano and Peña, *Multivariate analysis in vector time series*, 2000 (their distance with
/// equal weights); the mean over lags, which makes different numbers of lags comparable, is our choice.
///
/// # Errors
///
/// A series is empty, or holds NaN or an infinity.
///
/// ```
/// let slow = [0.0, 1.0, 2.0, 3.0, 3.0, 2.0, 1.0, 0.0];
/// let fast = [0.0, 3.0, 0.0, 3.0, 0.0, 3.0, 0.0, 3.0];
/// assert_eq!(calib_stats::autocorrelation_distance(&slow, &slow, 3)?, Some(0.0));
/// assert!(calib_stats::autocorrelation_distance(&slow, &fast, 3)?.is_some_and(|d| d > 0.9));
/// assert_eq!(calib_stats::autocorrelation_distance(&slow, &[1.0; 8], 3)?, None);
/// # Ok::<(), calib_stats::StatsError>(())
/// ```
pub fn autocorrelation_distance(
    x: &[f64],
    y: &[f64],
    lags: usize,
) -> Result<Option<f64>, StatsError> {
    check_finite("x", x)?;
    check_finite("y", y)?;
    let (Some(x), Some(y)) = (autocorrelation(x, lags)?, autocorrelation(y, lags)?) else {
        return Ok(None);
    };
    let squares: f64 = x.iter().zip(&y).map(|(x, y)| (x - y).powi(2)).sum();
    Ok((lags > 0).then(|| (squares / lags as f64).sqrt()))
}

/// Returns the usual number of lags for series of `len` values: a quarter of it, at most 100.
///
/// A quarter is Box and Jenkins's advice; the bound is our choice.
pub fn usual_lags(len: usize) -> usize {
    (len / 4).min(100)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_hand_calculation() {
        // Centred: -1.5, -0.5, 0.5, 1.5; variance 5, lag 1: 0.75 - 0.25 + 0.75.
        let found = autocorrelation(&[1.0, 2.0, 3.0, 4.0], 5).unwrap().unwrap();
        let expected = [0.25, -0.3, -0.45, 0.0, 0.0];
        assert!(found.iter().zip(expected).all(|(found, value)| (found - value).abs() < 1e-15));
        assert_eq!(autocorrelation(&[0.1; 9], 3).unwrap(), None);
        assert_eq!(autocorrelation(&[7.0], 3).unwrap(), None);
        assert_eq!(autocorrelation_distance(&[1.0, 2.0], &[1.0, 2.0], 0).unwrap(), None);
        assert!(autocorrelation(&[f64::INFINITY], 3).is_err());
    }

    proptest! {
        #[test]
        fn correlations_are_bounded_and_know_neither_unit_nor_zero(
            x in proptest::collection::vec(-3.0..3.0, 8..60),
            y in proptest::collection::vec(-3.0..3.0, 8..60),
            scale in 0.1..10.0_f64,
            shift in -5.0..5.0_f64,
        ) {
            let rho = autocorrelation(&x, 7).unwrap().unwrap();
            prop_assert!(rho.iter().all(|rho| rho.abs() <= 1.0));
            let other: Vec<f64> = x.iter().map(|x| scale * x + shift).collect();
            prop_assert!(autocorrelation_distance(&x, &other, 7).unwrap().unwrap() < 1e-9);
            let distance = autocorrelation_distance(&x, &y, 7).unwrap().unwrap();
            prop_assert_eq!(Some(distance), autocorrelation_distance(&y, &x, 7).unwrap());
            prop_assert!((0.0..=2.0).contains(&distance));
        }
    }
}
