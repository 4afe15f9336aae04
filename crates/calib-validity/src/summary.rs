//! Summary of each method over all pairs.

use calib_stats::{Interval, StatsError, mean, median};
use schemars::JsonSchema;
use serde::Serialize;

use crate::{
    CAP, Method, Pair,
    choices::Choices,
    over_plants::{OverPlants, mean_of},
};

/// Largest regret, and largest mean regret, that counts as good.
pub const GOOD: f64 = 0.05;

/// Regret of a method over all pairs in which it has a choice. Regrets above [`CAP`] count as that
/// value.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct MethodSummary {
    /// The method.
    pub method: Method,
    /// Number of pairs in which it has a choice.
    pub pairs: usize,
    /// Number of its choices that diverged on the held-out period.
    pub diverged: usize,
    /// Number of regrets that count as [`CAP`], including those of choices that diverged.
    pub capped: usize,
    /// Mean regret.
    pub mean: f64,
    /// 95 % upper bound of the mean, over plants.
    pub upper: Option<f64>,
    /// exp(mean of ln(1 + regret)) − 1: the typical factor, minus 1, by which its errors exceed the
    /// best ones.
    pub typical: f64,
    /// 95 % interval of the typical regret, over plants.
    pub typical_interval: Option<Interval>,
    /// Typical regret of the tenth of the pairs with the largest regrets, which is at least one pair.
    pub worst_tenth: f64,
    /// Median regret.
    pub median: f64,
    /// Share of pairs with a regret of at most 5 %.
    pub good: f64,
}

/// How well the ranking of a model agrees with the errors on the held-out period, and how stable
/// its choices are.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct RankAgreement {
    /// The model.
    pub model: String,
    /// Number of pairs in which a correlation is defined.
    pub pairs: usize,
    /// Mean of Spearman's correlations.
    pub mean: f64,
    /// 95 % interval of the mean, over plants.
    pub interval: Option<Interval>,
    /// The smallest correlation.
    pub smallest: f64,
    /// Mean over pairs of the share of resamples of the evidence that give the same choice.
    pub stability: Option<f64>,
    /// Mean over pairs of the share of updates that a race by halving would have saved.
    pub saved_by_halving: Option<f64>,
}

impl MethodSummary {
    pub(crate) fn of(chosen: &Choices, plants: &OverPlants) -> Result<Self, StatsError> {
        let regrets: Vec<f64> = chosen.regrets.iter().flatten().copied().collect();
        let counted: Vec<f64> =
            (0..chosen.regrets.len()).filter_map(|pair| chosen.counted(pair)).collect();
        let has = |pair: usize| chosen.regrets[pair].is_some();
        let value = |pair: usize| chosen.counted(pair).unwrap_or(f64::NAN);
        let good = regrets.iter().filter(|regret| **regret <= GOOD).count();
        let logarithms: Vec<f64> = counted.iter().map(|regret| regret.ln_1p()).collect();
        Ok(Self {
            method: chosen.method.clone(),
            pairs: regrets.len(),
            diverged: regrets.iter().filter(|regret| regret.is_infinite()).count(),
            capped: regrets.iter().filter(|regret| **regret > CAP).count(),
            mean: mean(&counted)?,
            upper: plants.upper_bound(has, |pairs| mean_of(pairs, value)),
            typical: mean(&logarithms)?.exp_m1(),
            typical_interval: plants.typical_interval(has, |pair: usize| value(pair).ln_1p()),
            worst_tenth: mean(&worst_tenth(logarithms))?.exp_m1(),
            median: median(&counted)?,
            good: good as f64 / regrets.len() as f64,
        })
    }
}

/// Returns the largest tenth of `values` `[n]`, n / 10 rounded, and at least one of them.
fn worst_tenth(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_by(|a, b| b.total_cmp(a));
    values.truncate(((values.len() + 5) / 10).max(1));
    values
}

/// Limits an interval to the range from −1 to 1.
pub(crate) fn correlations(interval: Option<Interval>) -> Option<Interval> {
    interval.map(|interval| Interval { low: interval.low.max(-1.0), high: interval.high.min(1.0) })
}

impl RankAgreement {
    /// Summarises a model; `None` if no pair has a correlation.
    pub(crate) fn of(
        model: &str,
        pairs: &[Pair],
        plants: &OverPlants,
    ) -> Result<Option<Self>, StatsError> {
        let own: Vec<_> = pairs.iter().map(|pair| pair.model(model)).collect();
        let by_pair: Vec<Option<f64>> =
            own.iter().map(|pair| pair.and_then(|pair| pair.spearman)).collect();
        let known: Vec<f64> = by_pair.iter().flatten().copied().collect();
        let stable: Vec<f64> = own.iter().flatten().filter_map(|pair| pair.stability).collect();
        let saved: Vec<f64> =
            own.iter().flatten().filter_map(|pair| pair.saved_by_halving).collect();
        if known.is_empty() {
            return Ok(None);
        }
        let interval = plants.interval(
            |pair| by_pair[pair].is_some(),
            |pairs| mean_of(pairs, |pair| by_pair[pair].unwrap_or(f64::NAN)),
        );
        Ok(Some(Self {
            model: model.to_owned(),
            pairs: known.len(),
            mean: mean(&known)?,
            interval: correlations(interval),
            smallest: known.iter().copied().fold(f64::INFINITY, f64::min),
            stability: (!stable.is_empty()).then(|| mean(&stable)).transpose()?,
            saved_by_halving: (!saved.is_empty()).then(|| mean(&saved)).transpose()?,
        }))
    }
}
