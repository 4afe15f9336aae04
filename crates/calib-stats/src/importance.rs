//! The importance of a hyperparameter.

use crate::StatsError;
use crate::error::{check, check_length};

/// Returns the share of the variance of y between groups: `η² = Σ_g n_g (ȳ_g − ȳ)² / Σ_i (y_i − ȳ)²`, 0 to 1.
///
/// `groups` gives for each of `values` the value of the hyperparameter at which it was measured. In a complete grid,
/// the shares of all hyperparameters and of their interactions sum to 1, as in a functional analysis of variance. In an
/// incomplete grid they may overlap. `None` if all values are the same. Source: main effects of Hutter, Hoos &
/// Leyton-Brown (2014), on the grid itself instead of a forest fitted to it.
///
/// # Errors
///
/// The input is empty, a value is not finite, or the inputs differ in length.
///
/// ```
/// // Two values of one hyperparameter (groups), two of another: only the first matters.
/// assert_eq!(calib_stats::importance(&[0, 0, 1, 1], &[1.0, 1.0, 3.0, 3.0])?, Some(1.0));
/// assert_eq!(calib_stats::importance(&[0, 1, 0, 1], &[1.0, 1.0, 3.0, 3.0])?, Some(0.0));
/// # Ok::<(), calib_stats::StatsError>(())
/// ```
pub fn importance(groups: &[usize], values: &[f64]) -> Result<Option<f64>, StatsError> {
    check("values", values)?;
    check_length("groups", groups.len(), values.len())?;
    if let Some(index) = values.iter().position(|value| value.is_infinite()) {
        return Err(StatsError::Infinite { what: "values", index });
    }
    let centre = mean_of(values);
    let total: f64 = values.iter().map(|value| (value - centre).powi(2)).sum();
    if total == 0.0 {
        return Ok(None);
    }
    let mut seen: Vec<usize> = groups.to_vec();
    seen.sort_unstable();
    seen.dedup();
    Ok(Some(
        (seen
            .into_iter()
            .map(|group: usize| {
                let own = groups.iter().zip(values).filter(|(other, _)| **other == group);
                let own: Vec<f64> = own.map(|(_, value)| *value).collect();
                own.len() as f64 * (mean_of(&own) - centre).powi(2)
            })
            .sum::<f64>()
            / total)
            .clamp(0.0, 1.0),
    ))
}

fn mean_of(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn effects_that_add_share_the_variance() {
        // y = 2a + b on {0, 1}²: variances 1 and 1/4.
        let values = [0.0, 1.0, 2.0, 3.0];
        assert_eq!(importance(&[0, 0, 1, 1], &values), Ok(Some(0.8)));
        assert_eq!(importance(&[0, 1, 0, 1], &values), Ok(Some(0.2)));
        assert_eq!(importance(&[0, 0], &[2.0, 2.0]), Ok(None));
    }

    #[test]
    fn what_cannot_be_shared_is_refused() {
        assert!(importance(&[], &[]).is_err());
        assert!(importance(&[0], &[1.0, 2.0]).is_err());
        assert!(importance(&[0, 1], &[1.0, f64::INFINITY]).is_err());
    }

    proptest! {
        /// Main effects and the interaction of a complete grid of two hyperparameters sum to 1. They do not change with
        /// shift and scale.
        #[test]
        fn a_complete_grid_is_divided(values in proptest::collection::vec(-1e3..1e3_f64, 12)) {
            let rows: Vec<usize> = (0..12).map(|place| place / 4).collect();
            let columns: Vec<usize> = (0..12).map(|place| place % 4).collect();
            let both: Vec<usize> = (0..12).collect();
            let share = |groups: &[usize]| importance(groups, &values).unwrap().unwrap_or(0.0);
            prop_assert!(share(&rows) + share(&columns) <= 1.0 + 1e-9);
            prop_assert!((share(&both) - 1.0).abs() < 1e-9);
            let other: Vec<f64> = values.iter().map(|value| 3.0 - 2.0 * value).collect();
            let shifted = importance(&rows, &other).unwrap().unwrap_or(0.0);
            prop_assert!((shifted - share(&rows)).abs() < 1e-9);
        }
    }
}
