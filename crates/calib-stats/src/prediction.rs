//! Errors of predictions against returns.

use serde::{Deserialize, Serialize};

use crate::StatsError;
use crate::error::check_pair;

/// A mean return smaller than this share of the returns' standard deviation makes NRMSE hard to read.
pub const SMALL_MEAN_RATIO: f64 = 0.1;

/// Root mean squared error between `predictions` `[steps]` and `returns` `[steps]`:
/// √(Σ(prediction − return)² / steps), in the unit of the cumulant. +∞ if any number is infinite.
///
/// # Errors
///
/// The inputs are empty, differ in length, or hold NaN.
pub fn rmse(predictions: &[f64], returns: &[f64]) -> Result<f64, StatsError> {
    check_pair(("predictions", predictions), ("returns", returns))?;
    let squares: f64 = predictions.iter().zip(returns).map(|(p, r)| (p - r).powi(2)).sum();
    let rmse = (squares / returns.len() as f64).sqrt();
    Ok(if rmse.is_nan() { f64::INFINITY } else { rmse })
}

/// RMSE relative to the mean return over the scored steps: rmse / |mean return|.
///
/// The paper divides by the mean return; the absolute value (our choice) keeps errors positive and their order
/// intact where a sensor is normalised to a negative mean. `None` where the mean return is 0 or not finite.
pub fn nrmse(rmse: f64, mean_return: f64) -> Option<f64> {
    (mean_return != 0.0 && mean_return.is_finite()).then(|| rmse / mean_return.abs())
}

/// Mean and standard deviation of the returns over the scored steps, accumulated one at a time (Welford 1962).
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ReturnSpread {
    steps: u64,
    mean: f64,
    squares: f64,
}

impl ReturnSpread {
    /// Adds the return of one scored step.
    pub fn push(&mut self, value: f64) {
        self.steps += 1;
        let before = value - self.mean;
        self.mean += before / self.steps as f64;
        self.squares += before * (value - self.mean);
    }

    /// Number of scored steps.
    pub const fn steps(&self) -> u64 {
        self.steps
    }

    /// Mean return; `None` before the first step.
    pub fn mean(&self) -> Option<f64> {
        (self.steps > 0).then_some(self.mean)
    }

    /// Standard deviation of the returns, divisor n; `None` before the first step.
    pub fn std(&self) -> Option<f64> {
        (self.steps > 0).then(|| (self.squares / self.steps as f64).sqrt())
    }

    /// Whether the mean return is so small beside the spread that NRMSE says little:
    /// |mean| < [`SMALL_MEAN_RATIO`] · std. Then read RMSE / std as well.
    pub fn is_mean_small(&self) -> bool {
        match (self.mean(), self.std()) {
            (Some(mean), Some(std)) => mean.abs() < SMALL_MEAN_RATIO * std,
            _ => false,
        }
    }
}

impl Extend<f64> for ReturnSpread {
    fn extend<Values: IntoIterator<Item = f64>>(&mut self, values: Values) {
        values.into_iter().for_each(|value| self.push(value));
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn rmse_of_known_numbers() {
        assert_eq!(rmse(&[1.0, 2.0, 3.0, 4.0], &[1.0, 4.0, 3.0, 0.0]), Ok(5f64.sqrt()));
        assert_eq!(rmse(&[f64::INFINITY], &[f64::INFINITY]), Ok(f64::INFINITY));
        assert!(matches!(rmse(&[1.0], &[]), Err(StatsError::LengthMismatch { .. })));
        assert!(matches!(rmse(&[], &[]), Err(StatsError::Empty { .. })));
    }

    #[test]
    fn nrmse_is_relative_to_the_size_of_the_mean() {
        assert_eq!(nrmse(0.5, 2.0), Some(0.25));
        assert_eq!(nrmse(0.5, -2.0), Some(0.25));
        assert_eq!(nrmse(f64::INFINITY, 2.0), Some(f64::INFINITY));
        assert_eq!(nrmse(0.5, 0.0), None);
    }

    #[test]
    fn a_mean_near_zero_is_noticed() {
        let mut spread = ReturnSpread::default();
        assert_eq!((spread.mean(), spread.std(), spread.is_mean_small()), (None, None, false));
        spread.extend([-1.0, 1.0, -1.0, 1.02]);
        assert!(spread.is_mean_small());
        spread.extend([5.0, 5.0]);
        assert!(!spread.is_mean_small());
    }

    proptest! {
        #[test]
        fn running_moments_agree_with_two_passes(values in prop::collection::vec(-1e3f64..1e3, 1..50)) {
            let mut spread = ReturnSpread::default();
            spread.extend(values.iter().copied());
            let n = values.len() as f64;
            let mean = values.iter().sum::<f64>() / n;
            let std = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
            prop_assert!((spread.mean().unwrap() - mean).abs() < 1e-9);
            prop_assert!((spread.std().unwrap() - std).abs() < 1e-9);
        }
    }
}
