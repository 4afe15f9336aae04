//! Order statistics.

use crate::StatsError;
use crate::error::check;

/// Returns the `p`-quantile of `values` `[n]`, in any order.
///
/// Type 7 of Hyndman & Fan (1996), the default of NumPy and R: with sorted x and h = (n − 1)p, x[⌊h⌋] + (h
/// − ⌊h⌋)(x[⌊h⌋ + 1] − x[⌊h⌋]). Between two equal infinities the result is that infinity.
///
/// # Errors
///
/// `values` is empty or holds NaN, `p` is outside [0, 1], or the quantile lies between opposed infinities.
pub fn quantile(values: &[f64], p: f64) -> Result<f64, StatsError> {
    SortedValues::new(values.to_vec())?.quantile(p)
}

/// Values in ascending order, for several quantiles of the same values.
#[derive(Debug, Clone)]
pub struct SortedValues(Vec<f64>);

impl SortedValues {
    /// Sorts `values` `[n]`.
    ///
    /// # Errors
    ///
    /// `values` is empty or holds NaN.
    pub fn new(mut values: Vec<f64>) -> Result<Self, StatsError> {
        check("values", &values)?;
        values.sort_by(f64::total_cmp);
        Ok(Self(values))
    }

    /// Returns the `p`-quantile by the formula of [`quantile`].
    ///
    /// # Errors
    ///
    /// `p` is outside [0, 1], or the quantile lies between opposed infinities.
    pub fn quantile(&self, p: f64) -> Result<f64, StatsError> {
        if !(0.0..=1.0).contains(&p) {
            return Err(StatsError::Probability { got: p });
        }
        let Self(sorted) = self;
        let h = (sorted.len() - 1) as f64 * p;
        let below = h.floor() as usize;
        let share = h.fract();
        let low = sorted[below];
        let high = sorted[(below + 1).min(sorted.len() - 1)];
        if share == 0.0 || low == high {
            return Ok(low);
        }
        let between = low + share * (high - low);
        if low.is_infinite() && high.is_infinite() {
            return Err(StatsError::OpposedInfinities { what: "values" });
        }
        // −∞ + share · ∞ is NaN. Any share of an infinite distance above −∞ is still −∞.
        Ok(if between.is_nan() { low } else { between })
    }
}

/// Returns the median of `values` `[n]`: the 0.5-quantile.
///
/// # Errors
///
/// As for [`quantile`].
pub fn median(values: &[f64]) -> Result<f64, StatsError> {
    quantile(values, 0.5)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const INF: f64 = f64::INFINITY;

    #[test]
    fn quantiles_of_known_numbers() {
        let values = [4.0, 1.0, 3.0, 2.0];
        assert_eq!(median(&values), Ok(2.5));
        assert_eq!(quantile(&values, 0.0), Ok(1.0));
        assert_eq!(quantile(&values, 1.0), Ok(4.0));
        assert_eq!(quantile(&values, 0.25), Ok(1.75));
        assert_eq!(median(&[7.0]), Ok(7.0));
    }

    #[test]
    fn infinities_are_ordered_like_numbers() {
        assert_eq!(median(&[1.0, INF, 2.0]), Ok(2.0));
        assert_eq!(median(&[1.0, INF]), Ok(INF));
        assert_eq!(median(&[-INF, 1.0]), Ok(-INF));
        assert_eq!(median(&[INF, INF]), Ok(INF));
        assert_eq!(median(&[-INF, INF]), Err(StatsError::OpposedInfinities { what: "values" }));
    }

    #[test]
    fn bad_input_is_an_error() {
        assert_eq!(quantile(&[], 0.5), Err(StatsError::Empty { what: "values" }));
        assert_eq!(quantile(&[1.0], 1.5), Err(StatsError::Probability { got: 1.5 }));
        assert!(quantile(&[1.0], f64::NAN).is_err());
    }

    proptest! {
        #[test]
        fn quantiles_rise_with_p_and_stay_inside(
            values in prop::collection::vec(-1e6f64..1e6, 1..40), p in 0.0f64..1.0, q in 0.0f64..1.0
        ) {
            let (p, q) = if p < q { (p, q) } else { (q, p) };
            let (low, high) = (quantile(&values, p).unwrap(), quantile(&values, q).unwrap());
            prop_assert!(low <= high);
            prop_assert!(quantile(&values, 0.0).unwrap() <= low);
            prop_assert!(high <= quantile(&values, 1.0).unwrap());
        }
    }
}
