//! Two methods on the same pairs.

use calib_stats::{Interval, StatsError, mean};
use serde::Serialize;

use crate::{Method, method::Chosen, over_plants::OverPlants, summary::mean_of};

/// One method against another, over the pairs in which both have a choice that did not diverge, but for the counts,
/// where a choice that diverged loses.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// The method.
    pub method: Method,
    /// The other one.
    pub against: Method,
    /// Pairs in which the method's regret is smaller.
    pub wins: usize,
    /// Pairs in which both are equal.
    pub ties: usize,
    /// Pairs in which it is larger.
    pub losses: usize,
    /// Pairs that the following is over.
    pub finite: usize,
    /// Mean of the method's regret minus the other's; below 0 the method is better.
    pub difference: Option<f64>,
    /// 95 % interval of it, over plants.
    pub interval: Option<Interval>,
    /// Geometric mean of the method's Online error divided by the other's; below 1 the method is better.
    pub error_ratio: Option<f64>,
    /// 95 % interval of it, over plants.
    pub error_ratio_interval: Option<Interval>,
}

impl Comparison {
    /// `None` if no pair has both.
    pub(crate) fn of(
        method: &Chosen,
        against: &Chosen,
        plants: &OverPlants,
    ) -> Result<Option<Self>, StatsError> {
        let both = |pair: usize| method.regrets[pair].zip(against.regrets[pair]);
        let finite = |pair: usize| both(pair).filter(|(a, b)| a.is_finite() && b.is_finite());
        let pairs = 0..method.regrets.len();
        let known: Vec<(f64, f64)> = pairs.clone().filter_map(both).collect();
        if known.is_empty() {
            return Ok(None);
        }
        let count =
            |holds: fn(f64, f64) -> bool| known.iter().filter(|(a, b)| holds(*a, *b)).count();
        let difference = |pair: usize| finite(pair).map_or(f64::NAN, |(a, b)| a - b);
        // (1 + a) / (1 + b) is the quotient of the errors: both are relative to the same best one.
        let ratio = |pair: usize| finite(pair).map_or(f64::NAN, |(a, b)| a.ln_1p() - b.ln_1p());
        let of: Vec<usize> = pairs.filter(|&pair| finite(pair).is_some()).collect();
        let each = |value: &dyn Fn(usize) -> f64| -> Result<Option<f64>, StatsError> {
            let values: Vec<f64> = of.iter().map(|&pair| value(pair)).collect();
            (!values.is_empty()).then(|| mean(&values)).transpose()
        };
        let has = |pair: usize| finite(pair).is_some();
        Ok(Some(Self {
            method: method.method.clone(),
            against: against.method.clone(),
            wins: count(|a, b| a < b),
            ties: count(|a, b| a == b),
            losses: count(|a, b| a > b),
            finite: of.len(),
            difference: each(&difference)?,
            interval: plants.interval(has, |pairs| mean_of(pairs, difference))?,
            error_ratio: each(&ratio)?.map(f64::exp),
            error_ratio_interval: plants
                .interval(has, |pairs| Some(mean_of(pairs, ratio)?.exp()))?,
        }))
    }
}
