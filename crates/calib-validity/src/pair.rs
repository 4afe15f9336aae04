//! What is known of one sensor of one plant.

use serde::Serialize;

use crate::ValidityError;

/// Larger regrets, and those of choices that diverged, count as this much in every mean, quotient and choice of a default: 1,000 %.
/// Without it one diverged choice would make every mean infinite, and one that nearly diverged would decide it.
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
    /// What else the agent is like, and how long it learns: what pairs are grouped by.
    pub task: Vec<(String, TaskValue)>,
    /// Mean error Online of each value of the grid, `[values]`; infinite if a run diverged. Shown, not judged by.
    pub online: Vec<f64>,
    /// Skill of the best value: 1 − RMSE / σ of the returns. None if it diverged.
    pub skill: Option<f64>,
    /// Regret of each value, `[values]`: exp(mean over held-out windows of ln(error / best error of the window)) − 1; infinite for
    /// values that diverged. None if every value did.
    pub regrets: Option<Vec<f64>>,
    /// The value that one would use without calib, if the grid has it.
    pub default: Option<usize>,
    /// The value that is best on the replayed log.
    pub log_replay: Option<usize>,
    /// The value that is best on the latest window of the replayed log.
    pub latest_window: Option<usize>,
    /// Regret of choosing by another held-out window; none where there is only one.
    pub another_window: Option<f64>,
    /// What each model chose.
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

/// A calibration model, and what is known of it, on one sensor of one plant.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ModelPair {
    /// Its name.
    pub model: String,
    /// The value that it chooses by the rule of the study.
    pub chosen: usize,
    /// Share of resamples of the evidence from which the rule chooses the same; none without resamples.
    pub stability: Option<f64>,
    /// The value that it chooses by each rule.
    pub rules: Vec<RuleChoice>,
    /// Share of the updates in its members and on the log that a race by halving would not have made; what it would have chosen then is
    /// the rule `halved`. None if that is not known.
    pub saved_by_halving: Option<f64>,
    /// Spearman's correlation of its ranking with the regrets Online.
    pub spearman: Option<f64>,
    /// RMSE of one-step predictions of the sensor on held-out data, normalised units.
    pub one_step: Option<f64>,
    /// The same divided by that of predicting no change.
    pub one_step_relative: Option<f64>,
    /// RMSE of one-step predictions of all columns.
    pub one_step_all: Option<f64>,
    /// Mean normalised warping distance of its rollouts from what was recorded.
    pub dtw: Option<f64>,
}

/// What a rule chooses from the evidence of a model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RuleChoice {
    /// The rule.
    pub rule: String,
    /// Its choice.
    pub chosen: usize,
}

impl Pair {
    /// That every choice is one of `values` values, that each has a regret, and that no regret is NaN or negative.
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
    /// What `rule` chooses.
    pub(crate) fn by(&self, rule: &str) -> Option<usize> {
        self.rules.iter().find(|choice| choice.rule == rule).map(|choice| choice.chosen)
    }
}

/// A regret as it counts.
pub(crate) fn capped(regret: f64) -> f64 {
    regret.min(CAP)
}
