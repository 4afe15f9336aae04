//! The data on one sensor of one plant.

use serde::Serialize;

use crate::ValidityError;

/// Cap for regrets, 1,000 %. Larger regrets, and those of diverged choices, count as this much in every mean, ratio and
/// choice of a default. Without it one diverged choice would make every mean infinite, and one that nearly diverged
/// would decide it.
pub const CAP: f64 = 10.0;

/// A sensor of a plant whose held-out data was replayed Online, by one score.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pair {
    /// The plant: the unit of all intervals.
    pub plant: String,
    /// The predicted sensor.
    pub sensor: String,
    /// The optimiser of the agent: a default may depend on it.
    pub optimiser: String,
    /// Other properties of the agent, and how long it learns. Pairs are grouped by them.
    pub task: Vec<(String, TaskValue)>,
    /// Mean error Online of each value of the grid, `[values]`; infinite if a run diverged. It is displayed, but not
    /// judged.
    pub online: Vec<f64>,
    /// Skill of the best value: 1 − RMSE / σ of the returns. `None` if it diverged.
    pub skill: Option<f64>,
    /// Regret of each value, `[values]`: exp(mean over held-out windows of ln(error / best error of the window)) − 1;
    /// infinite for values that diverged. `None` if every value did.
    pub regrets: Option<Vec<f64>>,
    /// The default value without calib, if the grid has it.
    pub default: Option<usize>,
    /// The value that is best on the replayed log.
    pub log_replay: Option<usize>,
    /// The value that is best on the latest window of the replayed log.
    pub latest_window: Option<usize>,
    /// Regret of choosing by another held-out window; `None` where there is only one.
    pub another_window: Option<f64>,
    /// The choices of each model.
    pub models: Vec<ModelPair>,
}

/// One feature of a task.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum TaskValue {
    /// A number, such as a discount factor.
    Number(f64),
    /// A name, such as that of an optimiser.
    Name(String),
}

/// A calibration model, with its choices and errors on one sensor of one plant.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ModelPair {
    /// Its name.
    pub model: String,
    /// The value that it chooses by the rule of the study.
    pub chosen: usize,
    /// Share of resamples of the evidence from which the rule chooses the same value; `None` without resamples.
    pub stability: Option<f64>,
    /// The value that it chooses by each rule.
    pub rules: Vec<RuleChoice>,
    /// Share of the updates on its members and the log that successive halving would have saved. The rule `halved` has
    /// the choice with halving. `None` if it is not known.
    pub saved_by_halving: Option<f64>,
    /// Spearman's correlation of its ranking with the regrets Online.
    pub spearman: Option<f64>,
    /// RMSE of one-step predictions of the sensor on held-out data, normalised units.
    pub one_step: Option<f64>,
    /// `one_step` divided by the error of predicting no change.
    pub one_step_relative: Option<f64>,
    /// RMSE of one-step predictions of all columns.
    pub one_step_all: Option<f64>,
    /// Mean normalised warping distance between its rollouts and the record.
    pub dtw: Option<f64>,
}

/// The choice of a rule from the evidence of a model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RuleChoice {
    /// The rule.
    pub rule: String,
    /// Its choice.
    pub chosen: usize,
}

impl Pair {
    /// Checks that every choice is one of `values` values, that each has a regret, and that no regret is NaN or
    /// negative.
    pub(crate) fn check(&self, values: usize) -> Result<(), ValidityError> {
        let plant = self.plant.clone();
        let sensor = self.sensor.clone();
        let lengths = [Some(self.online.len()), self.regrets.as_ref().map(Vec::len)];
        if let Some(got) = lengths.into_iter().flatten().find(|&got| got != values) {
            return Err(ValidityError::Values { plant, sensor, expected: values, got });
        }
        let regrets = self.regrets.iter().flatten().chain(&self.another_window);
        if let Some(&got) = regrets.into_iter().find(|regret| regret.is_nan() || **regret < 0.0) {
            return Err(ValidityError::Regret { plant, sensor, got });
        }
        let of_models = self.models.iter().flat_map(|model| {
            let rules = model.rules.iter().map(|rule| (model.model.as_str(), Some(rule.chosen)));
            [(model.model.as_str(), Some(model.chosen))].into_iter().chain(rules)
        });
        let others = [
            ("the default", self.default),
            ("log replay", self.log_replay),
            ("the latest window", self.latest_window),
        ];
        match of_models
            .chain(others)
            .find(|(_, choice)| choice.is_some_and(|choice| choice >= values))
        {
            Some((whose, Some(got))) => {
                let whose = whose.to_owned();
                Err(ValidityError::Choice { plant, sensor, whose, got, values })
            }
            _ => Ok(()),
        }
    }

    pub(crate) fn model(&self, name: &str) -> Option<&ModelPair> {
        self.models.iter().find(|model| model.model == name)
    }
}

impl ModelPair {
    /// Returns the choice of `rule`.
    pub(crate) fn by(&self, rule: &str) -> Option<usize> {
        self.rules.iter().find(|choice| choice.rule == rule).map(|choice| choice.chosen)
    }
}

/// Returns a regret, limited to [`CAP`].
pub(crate) fn capped(regret: f64) -> f64 {
    regret.min(CAP)
}
