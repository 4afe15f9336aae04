//! The verdict on the settings for one sensor.

use calib_agent::Part;
use calib_stats::Selection;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    Dropped, EnvironmentScores, Grade, PartChoice, Recommendation, Rule, RuleChoice, Share, Truth,
    differ::{differ, told_apart},
    simple::{self, SimpleComparison},
};

/// The verdict of a sweep on one sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SensorVerdict {
    /// The predicted sensor.
    pub sensor: String,
    /// The part of a run whose error counts.
    pub part: Part,
    /// The rule that chose the setting.
    pub rule: Rule,
    /// Index of the chosen setting.
    pub chosen: usize,
    /// How well held-out data supports the choice.
    pub grade: Grade,
    /// Score of each setting by the rule, lower is better: mean logarithms of errors, mean errors, mean ranks, or positions by worst rank.
    /// Not stored in files.
    #[serde(skip)]
    pub scores: Vec<f64>,
    /// The settings chosen in resamples of ensemble members, runs and windows of the log, the most frequent first; empty if a race dropped
    /// settings.
    pub stability: Vec<Share>,
    /// Share of these resamples that choose the same setting or a neighbour on the grid; none without resamples or neighbours.
    #[serde(default)]
    pub stability_nearby: Option<f64>,
    /// The choice of each rule.
    pub rules: Vec<RuleChoice>,
    /// Ranks over the ensemble members, with the worst-rank selection; none without a model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub selection: Option<Selection>,
    /// Settings that were dropped, best first; they rank behind all others.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub dropped: Vec<Dropped>,
    /// Errors in each ensemble member, over the runs that were made; empty without a model.
    pub members: Vec<EnvironmentScores>,
    /// Errors on replayed training windows.
    pub log_replay: Option<EnvironmentScores>,
    /// Results on held-out data.
    pub truth: Option<Truth>,
    /// Simple predictors on the same held-out windows, or on those of the log where held-out data can show nothing; empty if they are not
    /// known.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub simple: Vec<SimpleComparison>,
    /// Index of a setting that starts from a simple predictor and does not learn after the log. It is given if it is the choice, or if it
    /// is the default and the choice is not shown to reduce its error by 1 %.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub learning_off: Option<usize>,
    /// Choices by the errors over other parts of each run.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parts: Vec<PartChoice>,
    /// Share of the choice's squared error on held-out data in the first tenth of its runs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_up_share: Option<f64>,
    /// Warnings: few horizons, divergence, or ties between all settings.
    pub warnings: Vec<String>,
}

impl SensorVerdict {
    /// Returns the comparison with the simple predictor that the log prefers.
    pub fn preferred_simple(&self) -> Option<&SimpleComparison> {
        simple::preferred(&self.simple.iter().collect::<Vec<_>>())
    }

    /// Returns the simple predictor to use instead of the chosen agent: the training mean if nothing is shown to beat it.
    /// `None` where the agent beats that mean and is known to match the predictor that the log prefers, and no other
    /// predictor is better.
    pub fn simpler(&self) -> Option<&SimpleComparison> {
        simple::decisive(&self.simple, self.truth.as_ref(), self.learning_off)
    }

    /// Returns the distance of held-out values from the training mean, in spreads of the training range, if it is more
    /// than twenty. The agent learned nothing about such values.
    pub fn elsewhere(&self) -> Option<f64> {
        simple::elsewhere(&self.simple)
    }

    /// Lowers a *good* grade to *fair*, because inputs of the agent left their training range and held-out data
    /// reflects this.
    pub fn doubt_inputs(&mut self) {
        if self.grade == Grade::Good {
            self.grade = Grade::Fair;
        }
    }

    /// Returns the recommended action.
    pub fn recommendation(&self) -> Recommendation {
        // Of a choice that diverged nothing else was asked: a simple predictor may be better than the default too.
        let default_is_better = self.truth.as_ref().is_some_and(Truth::prefers_the_default)
            && self.elsewhere().is_none()
            && self.simpler().is_none();
        match self.grade {
            Grade::Simpler => Recommendation::UseSimplePredictor,
            Grade::Poor if default_is_better => Recommendation::KeepDefault,
            Grade::NotLearnt | Grade::Poor => Recommendation::DoNotDeploy,
            _ if !self.prefers_a_value() => Recommendation::KeepDefault,
            // An agent that learns nothing equals the predictor that it starts from.
            Grade::Good | Grade::Fair if self.learning_off.is_some() => {
                Recommendation::UseSimplePredictor
            }
            Grade::Good | Grade::Fair => Recommendation::Deploy,
            Grade::Unchecked => Recommendation::NotChecked,
        }
    }

    /// Whether the evidence prefers any setting to another. True for a single setting.
    fn prefers_a_value(&self) -> bool {
        differ(&self.scores)
    }

    /// Whether the members prefer any setting to another, or the replayed log where there is no model.
    pub fn tells_apart(&self) -> bool {
        self.selection.as_ref().map_or_else(|| self.prefers_a_value(), told_apart)
    }
}
