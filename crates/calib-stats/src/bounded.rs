//! Upper bounds for means of non-negative numbers.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statrs::distribution::{ChiSquared, ContinuousCDF};

use crate::StatsError;
use crate::error::check;
use crate::summary::{mean, sample_std};

/// Minimum number of observations for estimating their skewness.
const FEWEST: usize = 4;

/// Shape of the gamma distribution of a squared normal number, up to a factor.
const SQUARED_NORMAL: f64 = 0.5;

/// A non-negative number with its 95 % upper bound.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Bounded {
    /// The number; may be infinite (`null` in files for +∞).
    #[serde(with = "crate::diverged")]
    #[schemars(with = "crate::diverged::Stored")]
    pub value: f64,
    /// Upper bound with a confidence of 95 %; none if it cannot be computed.
    pub upper: Option<f64>,
}

/// Returns the 95 % upper bound of the mean of independent, non-negative `losses` `[n]`: 2nkm / χ²₀.₀₅(2nk).
///
/// The losses are modelled by a gamma distribution. With the mean m and the sample variance s², its shape is k = min(½,
/// (n − 1)/n · m² / s²). The loss against the best of several candidates is about the squared distance between the best
/// candidate of a window and the chosen one. If the choice is right, that distribution has a shape of ½, and otherwise
/// a larger one. Losses that are mostly 0 are more skewed, which their moments show. `None` for fewer than four losses,
/// where all are equal or all but one are 0, and where one is infinite.
///
/// Student's t assumes a symmetric distribution: its upper ends are too low for losses like these (docs/metrics.md has
/// the coverage of both). Source: bounds of gamma means after Grice & Bain (1980); the shape is our choice.
///
/// # Errors
///
/// `losses` is empty, holds NaN or a negative number.
pub fn upper_bound(losses: &[f64]) -> Result<Option<f64>, StatsError> {
    const WHAT: &str = "losses";
    check(WHAT, losses)?;
    if let Some(index) = losses.iter().position(|&loss| loss < 0.0) {
        return Err(StatsError::Negative { what: WHAT, index });
    }
    let above_nought = losses.iter().filter(|&&loss| loss > 0.0).count();
    let is_enough = losses.len() >= FEWEST && above_nought > 1;
    let Some(std) = sample_std(losses)?.filter(|&std| is_enough && std > 0.0) else {
        return Ok(None);
    };
    let n = losses.len() as f64;
    let mean = mean(losses)?;
    let shape = SQUARED_NORMAL.min((n - 1.0) / n * (mean / std).powi(2));
    let freedom = 2.0 * n * shape;
    let quantile = ChiSquared::new(freedom).ok().map(|distribution| distribution.inverse_cdf(0.05));
    Ok(quantile.map(|quantile| mean * freedom / quantile))
}

/// Returns the 95 % upper bound of a mean whose distribution may be skewed: `mean` + √19 · `standard_error`. `None`
/// without spread.
///
/// By Cantelli's inequality, a number of any distribution is at least k standard deviations below its mean with a
/// probability of at most 1 / (1 + k²), which is 5 % for k = √19. Use it for the mean of at least eight numbers with an
/// estimated spread. docs/metrics.md has its coverage.
pub fn cantelli_bound(mean: f64, standard_error: f64) -> Option<f64> {
    (standard_error > 0.0).then(|| mean + 19_f64.sqrt() * standard_error)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_bound_of_a_gamma_mean() {
        // m = 2, s² = 8/3: k = ½, so that 4 degrees of freedom remain; χ²₀.₀₅(4) = 0.710723.
        let bound = upper_bound(&[1.0, 1.0, 2.0, 4.0]).unwrap().unwrap();
        assert!((bound - 2.0 * 4.0 / 0.710_723).abs() < 1e-4, "{bound}");
        // Two losses of eight: m = ¼, s² = 3/14, k = 7/8 · 7/24 = 49/192, 49/12 degrees of freedom with χ²₀.₀₅ =
        // 0.744409.
        let bound = upper_bound(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]).unwrap().unwrap();
        assert!((bound - 0.25 * 49.0 / 12.0 / 0.744_409).abs() < 1e-4, "{bound}");
    }

    #[test]
    fn what_says_nothing_of_the_spread_has_no_bound() {
        assert_eq!(upper_bound(&[0.0; 9]), Ok(None));
        assert_eq!(upper_bound(&[0.5; 9]), Ok(None));
        assert_eq!(upper_bound(&[0.0, 0.0, 0.0, 0.0, 4.0]), Ok(None));
        assert_eq!(upper_bound(&[0.1, 0.2, 0.3]), Ok(None));
        assert_eq!(upper_bound(&[0.1, 0.2, 0.3, f64::INFINITY]), Ok(None));
    }

    #[test]
    fn what_is_no_loss_is_an_error() {
        assert_eq!(upper_bound(&[]), Err(StatsError::Empty { what: "losses" }));
        let negative = upper_bound(&[0.1, -0.2]);
        assert_eq!(negative, Err(StatsError::Negative { what: "losses", index: 1 }));
    }

    proptest! {
        #[test]
        fn the_bound_is_above_the_mean_and_in_its_unit(
            losses in prop::collection::vec(0.0f64..9.0, 4..20), factor in 0.01f64..100.0
        ) {
            let bound = upper_bound(&losses).unwrap();
            let scaled: Vec<f64> = losses.iter().map(|loss| loss * factor).collect();
            let scaled = upper_bound(&scaled).unwrap();
            prop_assert_eq!(bound.is_some(), scaled.is_some());
            if let Some((bound, scaled)) = bound.zip(scaled) {
                prop_assert!(bound > mean(&losses).unwrap());
                prop_assert!((scaled / bound / factor - 1.0).abs() < 1e-6);
            }
        }
    }
}
