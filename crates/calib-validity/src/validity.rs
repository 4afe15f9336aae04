//! All pairs together.

use calib_core::Seed;
use calib_stats::StatsError;
use serde::Serialize;

use crate::{
    Accuracy, Comparison, Method, MethodSummary, Pair, RankAgreement, ValidityError, accuracy,
    method::{Chosen, Judged},
    over_plants::OverPlants,
};

/// How to judge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// How often plants are drawn again for an interval.
    pub resamples: usize,
    /// Seed of these draws.
    pub seed: Seed,
}

impl Default for Options {
    fn default() -> Self {
        Self { resamples: 10_000, seed: Seed::new(0) }
    }
}

/// How well each method chooses over all pairs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Validity {
    /// Values of the grid.
    pub values: Vec<String>,
    /// The plants.
    pub plants: Vec<String>,
    /// Models that have a choice anywhere.
    pub models: Vec<String>,
    /// Plant–sensor pairs that were judged.
    pub pairs: usize,
    /// Pairs that were left out because every value diverged Online, as "sensor of plant".
    pub left_out: Vec<String>,
    /// How often plants were drawn again for an interval.
    pub resamples: usize,
    /// The value with the smallest mean regret over all pairs.
    pub best_default: usize,
    /// Each method over all pairs: models first.
    pub methods: Vec<MethodSummary>,
    /// Each model against each method that is none.
    pub comparisons: Vec<Comparison>,
    /// Rankings against Online.
    pub agreement: Vec<RankAgreement>,
    /// Each rule in each model.
    pub rules: Vec<MethodSummary>,
    /// Each rule against the paper's in each model.
    pub rule_comparisons: Vec<Comparison>,
    /// Whether the more accurate model chooses better.
    pub accuracy: Vec<Accuracy>,
    /// Every method in every pair.
    #[serde(skip)]
    pub each: Vec<PairRegret>,
}

/// One method in one pair.
#[derive(Clone, Debug, PartialEq)]
pub struct PairRegret {
    /// Number of the pair in [`Judging::pairs`](judge), those that were left out not counted.
    pub pair: usize,
    /// The method.
    pub method: Method,
    /// What it chose; none for a random choice.
    pub value: Option<usize>,
    /// Regret.
    pub regret: f64,
}

/// Judge `pairs`, whose values are called `values`.
///
/// # Errors
/// If there is no pair that can be judged, pairs do not have those values, or a number is NaN.
pub fn judge(
    values: Vec<String>,
    pairs: Vec<Pair>,
    options: &Options,
) -> Result<Validity, ValidityError> {
    let (mut judged, mut regrets, mut left_out) = (Vec::new(), Vec::new(), Vec::new());
    for pair in pairs {
        pair.check(values.len())?;
        match pair.regrets()? {
            Some(of) => {
                regrets.push(of);
                judged.push(pair);
            }
            None => left_out.push(format!("{} of {}", pair.sensor, pair.plant)),
        }
    }
    if judged.is_empty() {
        return Err(ValidityError::NoPairs);
    }
    let models = models(&judged);
    let all = Judged { pairs: &judged, regrets: &regrets, models: &models };
    let seed = options.seed.child("validity");
    let plants = OverPlants::new(judged.iter().map(|pair| &*pair.plant), options.resamples, seed);
    let methods = all.methods()?;
    let (own, others): (Vec<&Chosen>, Vec<&Chosen>) =
        methods.iter().partition(|chosen| matches!(chosen.method, Method::Model(_)));
    let rules: Vec<Vec<Chosen>> = models.iter().map(|model| all.rules(model)).collect();
    let summaries =
        |of: &mut dyn Iterator<Item = &Chosen>| -> Result<Vec<MethodSummary>, StatsError> {
            of.map(|chosen| MethodSummary::of(chosen, &plants)).collect()
        };
    let mut comparisons = Vec::new();
    for model in &own {
        for other in &others {
            comparisons.extend(Comparison::of(model, other, &plants)?);
        }
    }
    let mut rule_comparisons = Vec::new();
    for of_model in &rules {
        for other in &of_model[1..] {
            rule_comparisons.extend(Comparison::of(other, &of_model[0], &plants)?);
        }
    }
    let agreement = models.iter().map(|model| RankAgreement::of(model, &judged, &plants));
    let agreement = agreement.collect::<Result<Vec<_>, _>>()?;
    Ok(Validity {
        plants: all.plants().into_iter().map(str::to_owned).collect(),
        pairs: judged.len(),
        left_out,
        resamples: options.resamples,
        best_default: all.best_default(|_| true)?,
        comparisons,
        agreement: agreement.into_iter().flatten().collect(),
        rules: summaries(&mut rules.iter().flatten())?,
        rule_comparisons,
        accuracy: accuracy::accuracies(&judged, &regrets, &plants)?,
        each: each(&methods),
        methods: summaries(&mut methods.iter())?,
        models,
        values,
    })
}

/// Names of the models, in the order in which they come.
fn models(pairs: &[Pair]) -> Vec<String> {
    let mut models: Vec<String> = Vec::new();
    for model in pairs.iter().flat_map(|pair| &pair.models) {
        if !models.contains(&model.model) {
            models.push(model.model.clone());
        }
    }
    models
}

fn each(methods: &[Chosen]) -> Vec<PairRegret> {
    let pairs = methods.first().map_or(0, |chosen| chosen.regrets.len());
    let mut each = Vec::new();
    for pair in 0..pairs {
        for Chosen { method, values, regrets } in methods {
            let regret = regrets[pair];
            each.extend(regret.map(|regret| PairRegret {
                pair,
                method: method.clone(),
                value: values[pair],
                regret,
            }));
        }
    }
    each
}

#[cfg(test)]
mod tests;
