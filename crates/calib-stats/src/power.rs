//! The statistical power of a number of observations.

use statrs::distribution::{ContinuousCDF, StudentsT};

/// An upper limit on the number of observations.
const MANY: usize = 1_000_000;

/// Returns the smallest true mean that a two-sided test at 5 % against 0 detects with a power of 80 %, from `n`
/// independent observations with the standard deviation `std`:
///
/// (t₀.₉₇₅(n − 1) + t₀.₈(n − 1)) · std / √n
///
/// This is the usual approximation of the noncentral t distribution. `None` for fewer than two observations, or a `std`
/// that is not finite. Source: Cohen (1988), with t instead of normal quantiles because a dozen observations are usual
/// here.
pub fn smallest_difference(std: f64, n: usize) -> Option<f64> {
    let freedom = n.checked_sub(1).filter(|&freedom| freedom > 0)?;
    let t = StudentsT::new(0.0, 1.0, freedom as f64).ok()?;
    let sum = t.inverse_cdf(0.975) + t.inverse_cdf(0.8);
    (std >= 0.0 && std.is_finite()).then(|| sum * std / (n as f64).sqrt())
}

/// Returns the fewest observations, at least two, with which a mean of `difference` is detected as in
/// [`smallest_difference`]. `None` if a million do not suffice, or if the difference is 0.
pub fn observations_needed(std: f64, difference: f64) -> Option<usize> {
    if difference.is_nan() || difference <= 0.0 || !suffices(std, MANY, difference) {
        return None;
    }
    // Sufficiency is monotone in n, so bisection finds the limit.
    let mut few = 1;
    let mut enough = MANY;
    while enough - few > 1 {
        let between = usize::midpoint(few, enough);
        if suffices(std, between, difference) { enough = between } else { few = between }
    }
    Some(enough)
}

/// Returns whether so many observations show such a difference.
fn suffices(std: f64, observations: usize, difference: f64) -> bool {
    smallest_difference(std, observations).is_some_and(|least| least <= difference)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn differences_as_in_tables() {
        // t quantiles of 11 degrees of freedom: 2.200985 and 0.875530; of 1: 12.706205 and 1.376382.
        let of_twelve = smallest_difference(0.2, 12).unwrap();
        assert!((of_twelve - (2.200_985 + 0.875_530) * 0.2 / 12_f64.sqrt()).abs() < 1e-6);
        let of_two = smallest_difference(1.0, 2).unwrap();
        assert!((of_two - 14.082_587 / 2_f64.sqrt()).abs() < 1e-5);
        assert_eq!(smallest_difference(1.0, 1), None);
        assert_eq!(smallest_difference(f64::INFINITY, 9), None);
        // Normal quantiles give (1.96 + 0.84)² = 7.85 for a difference of one standard deviation. So few observations
        // need two more.
        assert_eq!(observations_needed(1.0, 1.0), Some(10));
        assert_eq!(observations_needed(0.0, 0.1), Some(2));
        assert_eq!(observations_needed(1.0, 1e-6), None);
        assert_eq!(observations_needed(1.0, 0.0), None);
    }

    proptest! {
        #[test]
        fn what_is_needed_is_the_first_that_suffices(std in 0.01..0.5_f64, difference in 0.05..1.0_f64) {
            let by_counting = (2..2000).find(|&n| smallest_difference(std, n).unwrap() <= difference);
            prop_assert_eq!(observations_needed(std, difference), by_counting);
        }
    }
}
