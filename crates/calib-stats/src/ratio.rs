//! Ratios of sums over independent parts.

use crate::error::check_pair;
use crate::summary::around;
use crate::{Estimate, StatsError};

/// Returns Σx / Σy over parts, `[parts]` each, with the t-interval of the linearised ratio:
/// ± t₀.₉₇₅(n − 1) · √(n/(n − 1) · Σ(x − r y)²) / Σy.
///
/// A part is weighted by its y: for the reward of an episode, the recorded share of the episode; for a plant, its
/// number of sensors. There is no interval for one part. Source: Cochran (1977), section 6.
///
/// # Errors
///
/// There are no parts, x and y differ in length, one holds NaN, or the sum of y is not above 0.
pub fn ratio_of_sums(x: &[f64], y: &[f64]) -> Result<Estimate, StatsError> {
    check_pair(("x", x), ("y", y))?;
    let total: f64 = y.iter().sum();
    if total.is_nan() || total <= 0.0 {
        return Err(StatsError::NoWeight { got: total });
    }
    let n = x.len() as f64;
    let value = x.iter().sum::<f64>() / total;
    let squares: f64 = x.iter().zip(y).map(|(x, y)| (x - value * y).powi(2)).sum();
    let error = (n / (n - 1.0) * squares).sqrt() / total;
    let known = x.len() > 1 && error.is_finite();
    let interval = known.then(|| around(value, error, n - 1.0)).flatten();
    Ok(Estimate { value, interval })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::summarise;

    #[test]
    fn a_part_counts_by_its_size() {
        // 10 per 1 and 1 per 0.1 are 10 each; the residuals are 0.
        let estimate = ratio_of_sums(&[10.0, 1.0], &[1.0, 0.1]).unwrap();
        assert!((estimate.value - 10.0).abs() < 1e-12);
        let interval = estimate.interval.unwrap();
        assert!(interval.high - interval.low < 1e-9, "{interval:?}");
        // 12 / 2, residuals ±2, √(2/1 · 8) / 2 = 2, t(1) = 12.706204736.
        let estimate = ratio_of_sums(&[4.0, 8.0], &[1.0, 1.0]).unwrap();
        assert!((estimate.interval.unwrap().high - 6.0 - 2.0 * 12.706_204_736).abs() < 1e-6);
        assert_eq!(ratio_of_sums(&[4.0], &[0.5]), Ok(Estimate { value: 8.0, interval: None }));
    }

    #[test]
    fn bad_input_is_an_error() {
        assert_eq!(ratio_of_sums(&[], &[]), Err(StatsError::Empty { what: "x" }));
        assert_eq!(ratio_of_sums(&[1.0], &[0.0]), Err(StatsError::NoWeight { got: 0.0 }));
        assert!(ratio_of_sums(&[1.0], &[1.0, 2.0]).is_err());
    }

    proptest! {
        #[test]
        fn equal_parts_are_a_plain_mean(
            x in prop::collection::vec(-9.0f64..9.0, 2..20), y in 0.1f64..9.0
        ) {
            let own = ratio_of_sums(&x, &vec![y; x.len()]).unwrap();
            let each: Vec<f64> = x.iter().map(|x| x / y).collect();
            let plain = summarise(&each).unwrap();
            prop_assert!((own.value - plain.mean).abs() < 1e-9);
            let (own, plain) = (own.interval.unwrap(), plain.interval.unwrap());
            prop_assert!((own.low - plain.low).abs() < 1e-6 && (own.high - plain.high).abs() < 1e-6);
        }
    }
}
