//! Whether the more accurate model chooses better.

use calib_stats::{Interval, StatsError, pooled_spearman};
use schemars::JsonSchema;
use serde::Serialize;

use crate::{ModelPair, Pair, over_plants::OverPlants, summary::correlations};

/// A measure of a model's accuracy without running agents on the held-out period: its predictions of held-out data, or
/// its rollouts. Lower is better.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Predictor {
    /// One-step error of the sensor.
    OneStep,
    /// One-step error of all columns.
    OneStepAll,
    /// Warping distance of rollouts.
    Dtw,
}

/// A measure of how badly a model chooses. Lower is better.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Badness {
    /// Regret of its choice.
    Regret,
    /// Disagreement of its ranking with the errors on the held-out period: minus Spearman's correlation.
    Disagreement,
}

/// Whether more accurate models choose better, within plant–sensor pairs.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Accuracy {
    /// The measure of accuracy.
    pub predictor: Predictor,
    /// The measure of how badly the model chooses.
    pub outcome: Badness,
    /// Number of pairs with at least two models that have both measures.
    pub pairs: usize,
    /// Number of models, summed over these pairs.
    pub models: usize,
    /// Pooled rank correlation within pairs: 1 if the more accurate model always chooses better.
    pub correlation: Option<f64>,
    /// 95 % interval of the correlation, over plants.
    pub interval: Option<Interval>,
}

impl Predictor {
    const ALL: [Self; 3] = [Self::OneStep, Self::OneStepAll, Self::Dtw];

    fn of(self, model: &ModelPair) -> Option<f64> {
        match self {
            Self::OneStep => model.one_step,
            Self::OneStepAll => model.one_step_all,
            Self::Dtw => model.dtw,
        }
    }
}

impl Badness {
    const ALL: [Self; 2] = [Self::Regret, Self::Disagreement];

    fn of(self, model: &ModelPair, regrets: &[f64]) -> Option<f64> {
        match self {
            Self::Regret => Some(regrets[model.chosen]),
            Self::Disagreement => Some(-model.spearman?),
        }
    }
}

/// Returns the correlations of all predictors with all outcomes.
pub(crate) fn accuracies(
    pairs: &[Pair],
    regrets: &[Vec<f64>],
    plants: &OverPlants,
) -> Result<Vec<Accuracy>, StatsError> {
    let mut all = Vec::new();
    for outcome in Badness::ALL {
        for predictor in Predictor::ALL {
            let groups: Vec<(Vec<f64>, Vec<f64>)> = pairs
                .iter()
                .zip(regrets)
                .map(|(pair, regrets)| {
                    pair.models
                        .iter()
                        .filter_map(|model| {
                            Some((predictor.of(model)?, outcome.of(model, regrets)?))
                        })
                        .unzip()
                })
                .collect();
            let has = |pair: usize| groups[pair].0.len() > 1;
            let correlation = |pairs: &[usize]| {
                let groups_of_pairs: Vec<(&[f64], &[f64])> =
                    pairs.iter().map(|&pair| (&*groups[pair].0, &*groups[pair].1)).collect();
                pooled_spearman(&groups_of_pairs)
            };
            let known: Vec<usize> = (0..pairs.len()).filter(|&pair| has(pair)).collect();
            all.push(Accuracy {
                predictor,
                outcome,
                pairs: known.len(),
                models: known.iter().map(|&pair| groups[pair].0.len()).sum(),
                correlation: correlation(&known)?,
                // NaN was refused above.
                interval: correlations(
                    plants.interval(has, |pairs| correlation(pairs).ok().flatten()),
                ),
            });
        }
    }
    Ok(all)
}
