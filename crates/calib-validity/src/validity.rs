//! The joint judgement of all pairs.

use calib_stats::StatsError;
use schemars::JsonSchema;
use serde::Serialize;

use crate::{
    Accuracy, Comparison, GroupSummary, Method, MethodSummary, OptimiserDefault, Pair, Power,
    RankAgreement, Test, ValidityError, accuracy,
    choices::{Choices, JudgedPairs},
    claims,
    defaults::{best_default, of_optimisers},
    groups::groups,
    over_plants::OverPlants,
};

/// How well each method chooses over all pairs.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Validity {
    /// The settings of the grid.
    pub values: Vec<String>,
    /// The plants.
    pub plants: Vec<String>,
    /// Models with a choice in at least one pair.
    pub models: Vec<String>,
    /// Number of plant–sensor pairs that were judged.
    pub pairs: usize,
    /// Pairs that were left out because every setting diverged on the held-out period, as "sensor of plant".
    pub left_out: Vec<String>,
    /// Number of pairs in which even the best setting predicts no better than the mean.
    pub not_learnt: usize,
    /// Index of the setting with the smallest typical regret over all pairs.
    pub best_default: usize,
    /// The best default for each optimiser.
    pub best_defaults_of_optimisers: Vec<OptimiserDefault>,
    /// Tests of the claims.
    pub tests: Vec<Test>,
    /// Each method over all pairs: models first, reference methods last.
    pub methods: Vec<MethodSummary>,
    /// Each model compared with each method that is not a model, and with the models after it.
    pub comparisons: Vec<Comparison>,
    /// Power of each comparison.
    pub power: Vec<Power>,
    /// Agreement of rankings with the held-out period.
    pub agreement: Vec<RankAgreement>,
    /// Regret of each rule in each model.
    pub rules: Vec<MethodSummary>,
    /// Each rule compared with the rules after it, over the pairs of all models.
    pub rule_comparisons: Vec<Comparison>,
    /// Models and log replay over pairs with similar tasks.
    pub groups: Vec<GroupSummary>,
    /// Whether more accurate models choose better.
    pub accuracy: Vec<Accuracy>,
    /// Regret of every method in every pair.
    #[serde(skip)]
    pub each: Vec<PairRegret>,
    /// The pairs that were judged.
    #[serde(skip)]
    pub judged: Vec<Pair>,
}

/// The regret of one method in one pair.
#[derive(Clone, Debug, PartialEq)]
pub struct PairRegret {
    /// Position of the pair in [`Validity::judged`].
    pub pair: usize,
    /// The method.
    pub method: Method,
    /// The chosen value; `None` if the method does not choose a single value.
    pub value: Option<usize>,
    /// Regret without cap: infinite if the choice diverged.
    pub regret: f64,
}

/// Judges `pairs`, whose values are named `values`. The claims say that models other than the `networks` choose better
/// than these.
///
/// # Errors
/// If there is no pair that can be judged, pairs have other values, or a number is NaN.
pub fn judge(
    values: Vec<String>,
    pairs: Vec<Pair>,
    networks: &[String],
) -> Result<Validity, ValidityError> {
    let mut judged = Vec::new();
    let mut regrets = Vec::new();
    let mut left_out = Vec::new();
    for pair in pairs {
        pair.check(values.len())?;
        match &pair.regrets {
            Some(of_pair) => {
                regrets.push(of_pair.clone());
                judged.push(pair);
            }
            None => left_out.push(format!("{} of {}", pair.sensor, pair.plant)),
        }
    }
    let Some(best_default) = best_default(&judged, &regrets, |_| true) else {
        return Err(ValidityError::NoPairs);
    };
    let models = models(&judged);
    let rules = rules(&judged);
    let all = JudgedPairs { pairs: &judged, regrets: &regrets, models: &models, rules: &rules };
    let plants = OverPlants::new(judged.iter().map(|pair| &*pair.plant));
    let in_all_models = (0..models.len()).flat_map(|_| judged.iter().map(|pair| &*pair.plant));
    let plants_of_all_models = OverPlants::new(in_all_models);
    let methods = all.methods()?;
    let comparisons = comparisons(&methods, |chosen| chosen.method.is_model(), &plants)?;
    let of_models: Vec<Choices> = models.iter().flat_map(|model| all.rules_in(model)).collect();
    let agreement = models.iter().map(|model| RankAgreement::of(model, &judged, &plants));
    let agreement = agreement.collect::<Result<Vec<_>, _>>()?;
    let summaries = summaries(&methods, &plants)?;
    Ok(Validity {
        plants: names(judged.iter().map(|pair| &pair.plant)),
        pairs: judged.len(),
        left_out,
        not_learnt: judged
            .iter()
            .filter(|pair| pair.skill.is_none_or(|skill| skill <= 0.0))
            .count(),
        best_default,
        best_defaults_of_optimisers: of_optimisers(&judged, &regrets),
        tests: claims::all(&summaries, &comparisons, networks),
        power: comparisons.iter().map(Power::of).collect::<Result<_, _>>()?,
        agreement: agreement.into_iter().flatten().collect(),
        rules: self::summaries(&of_models, &plants)?,
        rule_comparisons: self::comparisons(
            &all.rules_in_all_models(),
            |_| true,
            &plants_of_all_models,
        )?,
        groups: groups(&judged, &methods, &plants)?,
        accuracy: accuracy::accuracies(&judged, &regrets, &plants)?,
        each: each(&methods),
        methods: summaries,
        comparisons,
        judged,
        models,
        values,
    })
}

fn summaries(all: &[Choices], plants: &OverPlants) -> Result<Vec<MethodSummary>, StatsError> {
    let known = all.iter().filter(|chosen| chosen.regrets.iter().any(Option::is_some));
    known.map(|chosen| MethodSummary::of(chosen, plants)).collect()
}

/// Compares each method for which `is_own` is true with all others, each two methods once.
fn comparisons(
    methods: &[Choices],
    is_own: impl Fn(&Choices) -> bool,
    plants: &OverPlants,
) -> Result<Vec<Comparison>, StatsError> {
    let mut all = Vec::new();
    for (place, own) in methods.iter().enumerate().filter(|(_, own)| is_own(own)) {
        let others = methods.iter().enumerate();
        for (_, other) in others.filter(|&(other, chosen)| other > place || !is_own(chosen)) {
            all.extend(Comparison::of(own, other, plants)?);
        }
    }
    Ok(all)
}

/// Returns the names of the models, in order of appearance.
fn models(pairs: &[Pair]) -> Vec<String> {
    names(pairs.iter().flat_map(|pair| &pair.models).map(|model| &model.model))
}

/// Returns the names of the rules, in order of appearance.
fn rules(pairs: &[Pair]) -> Vec<String> {
    let models = pairs.iter().flat_map(|pair| &pair.models);
    names(models.flat_map(|model| &model.rules).map(|choice| &choice.rule))
}

/// Returns the distinct names, in order of appearance.
fn names<'a>(all: impl Iterator<Item = &'a String>) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for name in all {
        if !names.contains(name) {
            names.push(name.clone());
        }
    }
    names
}

fn each(methods: &[Choices]) -> Vec<PairRegret> {
    let pairs = methods.first().map_or(0, |chosen| chosen.regrets.len());
    let mut each = Vec::new();
    for pair in 0..pairs {
        for Choices { method, values, regrets } in methods {
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
pub(crate) mod tests;
