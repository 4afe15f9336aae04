//! Comparison of two methods on the same pairs.

use calib_stats::{Interval, StatsError, mean};
use schemars::JsonSchema;
use serde::Serialize;

use crate::{
    Method,
    choices::Choices,
    over_plants::{OverPlants, mean_of},
};

/// Relative excess error that still counts as no worse: 1 %.
pub const MARGIN: f64 = 0.01;

/// Conclusion from the interval of a quotient of errors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Finding {
    /// Less error: the interval lies below 1.
    Better,
    /// More error: the interval lies above 1.
    Worse,
    /// At most [`MARGIN`] more error: the interval reaches 1, and ends below 1 + [`MARGIN`].
    NoWorse,
    /// None of these.
    Untold,
}

impl Finding {
    /// Returns the finding for the interval of a ratio.
    pub(crate) fn of(interval: Option<Interval>) -> Self {
        match interval {
            Some(Interval { high, .. }) if high < 1.0 => Self::Better,
            Some(Interval { low, .. }) if low > 1.0 => Self::Worse,
            Some(Interval { high, .. }) if high < 1.0 + MARGIN => Self::NoWorse,
            _ => Self::Untold,
        }
    }
}

/// One method compared with another, over the pairs in which both have a choice. Regrets above [`CAP`](crate::CAP) count as that
/// value, except in wins, ties and losses.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Comparison {
    /// The method.
    pub method: Method,
    /// The other method.
    pub against: Method,
    /// Number of pairs in which both have a choice.
    pub pairs: usize,
    /// Number of pairs in which the method's regret is smaller.
    pub wins: usize,
    /// Number of pairs in which both regrets are equal.
    pub ties: usize,
    /// Number of pairs in which the method's regret is larger.
    pub losses: usize,
    /// Mean of the method's regret minus the other's; below 0 the method is better.
    pub difference: f64,
    /// Geometric mean of the method's error on the held-out period divided by the other's; below 1 the method is better.
    pub error_ratio: f64,
    /// 95 % interval of this quotient, over plants.
    pub error_ratio_interval: Option<Interval>,
    /// Conclusion from this interval.
    pub finding: Finding,
    /// Mean over pairs of ln(quotient), plant by plant.
    #[serde(skip)]
    pub(crate) of_plants: Vec<f64>,
}

impl Comparison {
    /// Compares two methods; `None` if no pair has both.
    pub(crate) fn of(
        method: &Choices,
        against: &Choices,
        plants: &OverPlants,
    ) -> Result<Option<Self>, StatsError> {
        let has = |pair: usize| method.regrets[pair].is_some() && against.regrets[pair].is_some();
        let known: Vec<usize> = (0..method.regrets.len()).filter(|&pair| has(pair)).collect();
        if known.is_empty() {
            return Ok(None);
        }
        let regrets: Vec<(f64, f64)> = known
            .iter()
            .filter_map(|&pair| method.regrets[pair].zip(against.regrets[pair]))
            .collect();
        let counted = |pair| method.counted(pair).zip(against.counted(pair));
        let ratio = |pair: usize| counted(pair).map_or(f64::NAN, |(a, b)| quotient(a, b));
        let differences: Vec<f64> =
            known.iter().map(|&pair| counted(pair).map_or(f64::NAN, |(a, b)| a - b)).collect();
        let ratios: Vec<f64> = known.iter().map(|&pair| ratio(pair)).collect();
        let error_ratio_interval =
            quotient_interval(plants.interval(has, |pairs| mean_of(pairs, ratio)));
        let of_plants = plants.each(has);
        Ok(Some(Self {
            method: method.method.clone(),
            against: against.method.clone(),
            pairs: known.len(),
            wins: regrets.iter().filter(|(a, b)| a < b).count(),
            ties: regrets.iter().filter(|(a, b)| a == b).count(),
            losses: regrets.iter().filter(|(a, b)| a > b).count(),
            difference: mean(&differences)?,
            error_ratio: mean(&ratios)?.exp(),
            error_ratio_interval,
            finding: Finding::of(error_ratio_interval),
            of_plants: of_plants.iter().filter_map(|pairs| mean_of(pairs, ratio)).collect(),
        }))
    }
}

/// Returns ln of the ratio of two errors from their regrets, which are relative to the same best error:
/// ln((1 + a) / (1 + b)).
pub(crate) fn quotient(a: f64, b: f64) -> f64 {
    a.ln_1p() - b.ln_1p()
}

/// Returns the interval of a ratio from that of its logarithm.
pub(crate) fn quotient_interval(interval: Option<Interval>) -> Option<Interval> {
    interval.map(|interval| Interval { low: interval.low.exp(), high: interval.high.exp() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn finding(low: f64, high: f64) -> Finding {
        Finding::of(Some(Interval { low, high }))
    }

    #[test]
    fn findings_follow_from_the_ends_of_the_interval() {
        assert_eq!(finding(0.8, 0.999), Finding::Better);
        assert_eq!(finding(1.001, 1.005), Finding::Worse);
        assert_eq!(finding(0.98, 1.009), Finding::NoWorse);
        assert_eq!(finding(1.0, 1.0), Finding::NoWorse, "the same choices everywhere");
        assert_eq!(finding(0.98, 1.01), Finding::Untold);
        assert_eq!(Finding::of(None), Finding::Untold);
    }
}
