//! Each method over all pairs.

use calib_stats::{Interval, StatsError, mean, median};
use serde::Serialize;

use crate::{Method, Pair, method::Chosen, over_plants::OverPlants};

/// A regret up to this counts as good, as in the verdicts of a report.
pub const GOOD: f64 = 0.05;

/// Regret of a method over all pairs in which it has a choice.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MethodSummary {
    /// The method.
    pub method: Method,
    /// Pairs in which it has a choice.
    pub pairs: usize,
    /// How many of its choices diverged Online.
    pub diverged: usize,
    /// Mean regret; infinite (`null` in files) if a choice diverged.
    pub mean: f64,
    /// 95 % interval of the mean, over plants.
    pub interval: Option<Interval>,
    /// exp(mean of ln(1 + regret)) − 1: by what factor, typically, its errors exceed the best ones.
    pub typical: f64,
    /// 95 % interval of the typical regret, over plants.
    pub typical_interval: Option<Interval>,
    /// Median regret.
    pub median: f64,
    /// Share of pairs with a regret of at most 5 %.
    pub good: f64,
}

/// How well the ranking of a model agrees with Online.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RankAgreement {
    /// The model.
    pub model: String,
    /// Pairs in which a correlation is defined.
    pub pairs: usize,
    /// Mean of Spearman's correlations.
    pub mean: f64,
    /// 95 % interval of the mean, over plants.
    pub interval: Option<Interval>,
    /// The smallest.
    pub smallest: f64,
}

impl MethodSummary {
    pub(crate) fn of(chosen: &Chosen, plants: &OverPlants) -> Result<Self, StatsError> {
        let regrets: Vec<f64> = chosen.regrets.iter().flatten().copied().collect();
        let has = |pair: usize| chosen.regrets[pair].is_some();
        let value = |pair: usize| chosen.regrets[pair].unwrap_or(f64::NAN);
        let logarithm = |pair: usize| value(pair).ln_1p();
        let logarithms: Vec<f64> = regrets.iter().map(|regret| regret.ln_1p()).collect();
        Ok(Self {
            method: chosen.method.clone(),
            pairs: regrets.len(),
            diverged: regrets.iter().filter(|regret| regret.is_infinite()).count(),
            mean: mean(&regrets)?,
            interval: plants.interval(has, |pairs| mean_of(pairs, value))?,
            typical: mean(&logarithms)?.exp_m1(),
            typical_interval: plants
                .interval(has, |pairs| Some(mean_of(pairs, logarithm)?.exp_m1()))?,
            median: median(&regrets)?,
            good: regrets.iter().filter(|&&regret| regret <= GOOD).count() as f64
                / regrets.len() as f64,
        })
    }
}

impl RankAgreement {
    /// `None` if no pair has a correlation.
    pub(crate) fn of(
        model: &str,
        pairs: &[Pair],
        plants: &OverPlants,
    ) -> Result<Option<Self>, StatsError> {
        let of: Vec<Option<f64>> =
            pairs.iter().map(|pair| pair.model(model).and_then(|of| of.spearman)).collect();
        let known: Vec<f64> = of.iter().flatten().copied().collect();
        if known.is_empty() {
            return Ok(None);
        }
        let value = |pair: usize| of[pair].unwrap_or(f64::NAN);
        Ok(Some(Self {
            model: model.to_owned(),
            pairs: known.len(),
            mean: mean(&known)?,
            interval: plants.interval(|pair| of[pair].is_some(), |pairs| mean_of(pairs, value))?,
            smallest: known.iter().copied().fold(f64::INFINITY, f64::min),
        }))
    }
}

/// The mean of `value` over `pairs`; `None` for none.
pub(crate) fn mean_of(pairs: &[usize], value: impl Fn(usize) -> f64) -> Option<f64> {
    let sum: f64 = pairs.iter().map(|&pair| value(pair)).sum();
    (!pairs.is_empty()).then(|| sum / pairs.len() as f64)
}
