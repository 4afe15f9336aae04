//! Ratios of the errors of two forecasts of the same steps.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::error::check_pair;
use crate::summary::around;
use crate::{Interval, StatsError};

/// Number of blocks of time that the steps are cut into.
const BLOCKS: usize = 16;

/// RMSE of x / RMSE of y, for forecasts of the same steps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ErrorRatio {
    /// The quotient; infinite if only the error of x is infinite, or if all errors of y are 0 (`null` in files for +∞).
    #[serde(with = "crate::diverged")]
    #[schemars(with = "crate::diverged::Stored")]
    pub ratio: f64,
    /// 95 % interval; `None` for fewer than two blocks, or if the quotient is 0 or infinite.
    pub interval: Option<Interval>,
    /// Number of blocks of time that the interval is computed over.
    pub blocks: usize,
    /// Number of steps.
    pub steps: usize,
    /// Number of steps at which the error of x is smaller, and at which the error of y is.
    pub smaller: [usize; 2],
}

impl ErrorRatio {
    /// Whether the interval excludes 1, so that one error is clearly smaller. False without an interval.
    pub fn is_told(&self) -> bool {
        self.interval.is_some_and(|interval| interval.low > 1.0 || interval.high < 1.0)
    }
}

/// Returns the ratio of the root mean squares of two forecasts, from their squared errors `x` and `y` `[steps]` in time
/// order: √(Σx / Σy).
///
/// Errors of neighbouring steps are dependent. The steps are therefore cut into B = 16 blocks of equal length, as far
/// as possible, with sums Xᵦ and Yᵦ. There are fewer blocks for fewer than 32 steps: each has at least two steps. To
/// first order, the error of ½ ln (Σx / Σy) is the mean of zᵦ = ½ B (Xᵦ / Σx − Yᵦ / Σy), so the interval is √(Σx / Σy)
/// · exp(± t₀.₉₇₅(B − 1) · s(z) / √B). Steps that are hard to predict are so for both forecasts, and cancel. Source:
/// linearised ratios (Cochran 1977, section 6); t-intervals over 16 blocks of a series as Ibragimov & Müller (2010);
/// pairing as Diebold & Mariano (1995).
///
/// `None` where the ratio is not defined: both sums are 0, or both infinite.
///
/// # Errors
///
/// There are no steps, `x` and `y` differ in length, or one holds NaN or a negative number.
pub fn error_ratio(x: &[f64], y: &[f64]) -> Result<Option<ErrorRatio>, StatsError> {
    check_pair(("squared errors of x", x), ("squared errors of y", y))?;
    for (what, errors) in [("squared errors of x", x), ("squared errors of y", y)] {
        if let Some(index) = errors.iter().position(|&error| error < 0.0) {
            return Err(StatsError::Negative { what, index });
        }
    }
    let steps = x.len();
    let blocks = BLOCKS.min(x.len() / 2).max(1);
    let all_x = total(x);
    let all_y = total(y);
    let ratio = (all_x / all_y).sqrt();
    if ratio.is_nan() {
        return Ok(None);
    }
    let z: Vec<f64> = (0..blocks)
        .map(|number| {
            let block = number * steps / blocks..(number + 1) * steps / blocks;
            let x = total(&x[block.clone()]);
            let y = total(&y[block]);
            0.5 * blocks as f64 * (x / all_x - y / all_y)
        })
        .collect();
    let interval = (blocks > 1 && ratio > 0.0 && ratio.is_finite()).then(|| {
        let squares: f64 = z.iter().map(|z| z * z).sum();
        let standard_error = (squares / ((blocks - 1) * blocks) as f64).sqrt();
        let logarithm = around(ratio.ln(), standard_error, (blocks - 1) as f64)?;
        Some(Interval { low: logarithm.low.exp(), high: logarithm.high.exp() })
    });
    let smaller = [
        x.iter().zip(y).filter(|(x, y)| x < y).count(),
        x.iter().zip(y).filter(|(x, y)| x > y).count(),
    ];
    Ok(Some(ErrorRatio { ratio, interval: interval.flatten(), blocks, steps, smaller }))
}

fn total(errors: &[f64]) -> f64 {
    errors.iter().sum()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_quotient_by_hand() {
        // Two blocks of two steps: X = 1, 3 and Y = 2, 2, so z = (1/4 - 1/2, 3/4 - 1/2), s = sqrt(1/8), t(1) = 12.706204736.
        let compared = error_ratio(&[0.5, 0.5, 1.0, 2.0], &[1.0, 1.0, 1.0, 1.0]).unwrap().unwrap();
        let half = (12.706_204_736_f64 * 0.125_f64.sqrt() / 2_f64.sqrt()).exp();
        assert_eq!(
            (compared.ratio, compared.blocks, compared.steps, compared.smaller),
            (1.0, 2, 4, [2, 1])
        );
        assert!((compared.interval.unwrap().high - half).abs() < 1e-7 * half);
        assert!(!compared.is_told());
    }

    #[test]
    fn what_is_hard_for_both_cancels() {
        // A storm in one block: both errors are a hundred times larger there, and x is always half of y.
        let y: Vec<f64> = (0..64).map(|step| if step < 8 { 100.0 } else { 1.0 }).collect();
        let x: Vec<f64> = y.iter().map(|y| y / 4.0).collect();
        let compared = error_ratio(&x, &y).unwrap().unwrap();
        assert_eq!((compared.ratio, compared.blocks, compared.smaller), (0.5, 16, [64, 0]));
        assert_eq!(compared.interval, Some(Interval { low: 0.5, high: 0.5 }));
        assert!(compared.is_told());
    }

    #[test]
    fn degenerate_errors() {
        let inf = f64::INFINITY;
        assert_eq!(error_ratio(&[0.0, 0.0], &[0.0, 0.0]), Ok(None));
        assert_eq!(error_ratio(&[inf, 0.0], &[inf, 1.0]), Ok(None));
        let worst = error_ratio(&[inf, 1.0, 1.0, 1.0], &[1.0; 4]).unwrap().unwrap();
        assert_eq!((worst.ratio, worst.interval, worst.smaller), (inf, None, [0, 1]));
        let perfect = error_ratio(&[0.0; 4], &[1.0; 4]).unwrap().unwrap();
        assert_eq!((perfect.ratio, perfect.interval), (0.0, None));
        let one = error_ratio(&[1.0], &[4.0]).unwrap().unwrap();
        assert_eq!((one.ratio, one.interval, one.blocks), (0.5, None, 1));
        assert_eq!(
            error_ratio(&[1.0], &[-1.0]),
            Err(StatsError::Negative { what: "squared errors of y", index: 0 })
        );
        assert!(matches!(error_ratio(&[], &[]), Err(StatsError::Empty { .. })));
    }

    proptest! {
        #[test]
        fn swapped_forecasts_have_the_inverse_quotient(
            pairs in prop::collection::vec((0.01f64..9.0, 0.01f64..9.0), 4..80)
        ) {
            let (x, y): (Vec<f64>, Vec<f64>) = pairs.into_iter().unzip();
            let one = error_ratio(&x, &y).unwrap().unwrap();
            let other = error_ratio(&y, &x).unwrap().unwrap();
            prop_assert!((one.ratio * other.ratio - 1.0).abs() < 1e-12);
            let (one, other) = (one.interval.unwrap(), other.interval.unwrap());
            prop_assert!((one.low * other.high - 1.0).abs() < 1e-9);
            prop_assert!((one.high * other.low - 1.0).abs() < 1e-9);
        }
    }
}
