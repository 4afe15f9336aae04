//! What to deploy, and how well the evidence supports it.

use calib_agent::SimplePredictor;
use calib_stats::{Bounded, Estimate};

use super::{ChoiceBaseline, Grade, Recommendation, SimpleRow, Simpler};
use crate::Setting;

/// The setting that a calibration model chose for one sensor, and its support.
#[derive(Debug, Clone, PartialEq)]
pub struct Verdict {
    /// The predicted sensor.
    pub sensor: String,
    /// The swept hyperparameter, as in the study file.
    pub field: String,
    /// The calibration model that chose, or "log replay" without one.
    pub model: String,
    /// The chosen setting.
    pub chosen: Setting,
    /// Support by held-out data.
    pub grade: Grade,
    /// Selection method.
    pub reason: Reason,
    /// Whether the evidence shows differences between settings.
    pub evidence: Separation,
    /// All settings that share the smallest worst rank, in grid order.
    pub tie_set: Vec<Setting>,
    /// Worst rank of the choice; 1 = best in every ensemble member, 0 without a model.
    pub worst_rank: usize,
    /// Number of settings.
    pub values: usize,
    /// Number of ensemble members; 0 without a model.
    pub members: usize,
    /// Choices of resamples of ensemble members, runs and windows of the log, with their shares; the most frequent first.
    pub stability: Vec<(Setting, f64)>,
    /// Share of the resamples that choose the same setting or its neighbour on the grid; `None` where that has no meaning.
    pub stability_nearby: Option<f64>,
    /// Share of the held-out values outside the training range; `None` if unknown.
    pub outside_training: Option<f64>,
    /// Distance of held-out values from the training mean, in standard deviations of the training range. `None` unless it is so
    /// large that agents learned nothing about such values.
    pub elsewhere: Option<f64>,
    /// Result of the choice on held-out data; `None` if no data was held out.
    pub online: Option<HeldOutResult>,
    /// Other selection methods and their costs.
    pub alternatives: Vec<Alternative>,
    /// Simple predictors on the same held-out windows, the simplest first; empty if unknown. With `agent_on_log` they are those
    /// on windows of the replayed log.
    pub simple: Vec<SimpleRow>,
    /// Score of the choice on windows of the replayed log, as a geometric mean, if simple predictors are compared with it there.
    /// `None` if they are compared on held-out windows.
    pub agent_on_log: Option<f64>,
    /// The simple predictor to use instead of the agent, if the agent is not shown to match it.
    pub simpler: Option<Simpler>,
    /// The simple predictor that the log prefers, if the agent is shown to match it.
    pub matched: Option<Simpler>,
    /// The simple predictor to use because further learning adds nothing. Either the choice is that predictor and learns nothing,
    /// or the choice is not shown to be 1 % better than such a default.
    pub frozen: Option<SimplePredictor>,
    /// Whether that is the choice itself, which learns nothing then: what it gains on the default is no gain by learning.
    pub learns_nothing: bool,
    /// Choice and advice by each part of the runs.
    pub parts: Vec<PartRow>,
    /// Share of the choice's squared error on held-out data that falls into the first tenth of its runs.
    pub start_up_share: Option<f64>,
    /// Notes to read before relying on this verdict: [`super::caveats`].
    pub notes: Vec<String>,
}

/// The choice and the advice by the errors over one part of each run.
#[derive(Debug, Clone, PartialEq)]
pub struct PartRow {
    /// The part in words: "whole run".
    pub part: &'static str,
    /// The setting chosen by this part.
    pub chosen: Setting,
    /// Mean score of the verdict's choice over this part of the held-out runs.
    pub error: Option<f64>,
    /// What to do if errors over this part count.
    pub recommendation: Recommendation,
    /// The simple predictor to use, if the recommendation is one.
    pub simple: Option<SimplePredictor>,
    /// The simple predictor that the chosen setting is compared with over this part; `None` if unknown.
    pub compared: Option<SimplePredictor>,
    /// Error of the chosen setting over this part divided by that of this predictor: geometric mean over windows.
    pub ratio: Option<Estimate>,
}

/// Whether errors differ between the settings of the grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Separation {
    /// Some setting has a smaller error than another.
    Apart,
    /// All settings have the same error.
    Alike,
}

/// Training runs from which a choice by logarithms is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sources {
    /// Only those in ensemble members.
    Members,
    /// Those in ensemble members and on the replayed log.
    MembersAndLog,
    /// Only those on the replayed log: there is no model.
    Log,
}

/// Criterion by which the choice is the best.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reason {
    /// The smallest worst rank over ensemble members.
    WorstRank,
    /// The smallest mean rank over ensemble members.
    MeanRank,
    /// The smallest mean error over ensemble members.
    MeanError,
    /// The smallest mean logarithm of the error over training runs in ensemble members.
    MeanLogError {
        /// Number of training runs.
        streams: usize,
    },
    /// The smallest mean logarithm of the error over training runs in ensemble members and on the replayed log.
    Pooled {
        /// Number of training runs.
        streams: usize,
        /// Environments of the training runs.
        sources: Sources,
    },
    /// The smallest mean logarithm of the error over windows of the replayed log.
    LogReplay {
        /// Number of windows.
        streams: usize,
    },
    /// The default, unless another setting is better by more than one standard error over training runs.
    OneStandardError {
        /// Number of training runs.
        streams: usize,
        /// Environments of the training runs.
        sources: Sources,
    },
}

/// Result of the choice on held-out data.
#[derive(Debug, Clone, PartialEq)]
pub struct HeldOutResult {
    /// Judged part of the runs: "over the whole run".
    pub part: String,
    /// Number of replayed windows of the held-out period.
    pub windows: usize,
    /// Number of runs over all windows.
    pub runs: usize,
    /// Whether the errors of different settings differ.
    pub values: Separation,
    /// Whether the sensor is constant in every window, so that there was nothing to predict.
    pub stands_still: bool,
    /// Mean held-out score of the choice; infinite if it diverged.
    pub chosen_error: f64,
    /// 1 − RMSE / standard deviation of the returns; predicting the mean has skill 0.
    pub chosen_skill: Option<f64>,
    /// The best setting over all windows.
    pub best: Setting,
    /// Mean held-out score of the best setting.
    pub best_error: f64,
    /// Skill of the best setting.
    pub best_skill: Option<f64>,
    /// Regret: exp(mean over windows of ln(error / best error of the window)) − 1; `None` if undefined.
    pub regret: Option<Bounded>,
    /// Error of the choice divided by that of the default: geometric mean over windows; `None` if the choice is the default.
    pub against_default: Option<Estimate>,
    /// Spearman correlation between the ranking by the evidence and that on held-out data; `None` if undefined.
    pub spearman: Option<f64>,
    /// Kendall's τ-b between these rankings.
    pub kendall: Option<f64>,
    /// Whether the choice is among the k best on held-out data.
    pub top_k: Option<TopK>,
}

/// Whether the choice is among the `k` best settings on held-out data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopK {
    /// Number of settings that count as best.
    pub k: usize,
    /// Whether the choice is one of them.
    pub hit: bool,
}

/// Another selection method and its cost.
#[derive(Debug, Clone, PartialEq)]
pub struct Alternative {
    /// The method.
    pub baseline: ChoiceBaseline,
    /// The setting that it would have chosen, if it chooses one setting.
    pub value: Option<Setting>,
    /// Its regret on held-out data; `None` without held-out data.
    pub regret: Option<Bounded>,
}

impl Verdict {
    /// Whether a calibration model contributed to the verdict. Otherwise log replay decided alone.
    pub(crate) const fn has_model(&self) -> bool {
        self.members > 0
    }

    /// Returns the result of another selection method.
    pub fn alternative(&self, baseline: ChoiceBaseline) -> Option<&Alternative> {
        self.alternatives.iter().find(|alternative| alternative.baseline == baseline)
    }

    /// Returns the regret of the choice, if it is known.
    pub(crate) fn regret(&self) -> Option<f64> {
        Some(self.online.as_ref()?.regret?.value)
    }

    /// Returns the regret of another selection method, if it is known.
    pub(crate) fn regret_of(&self, baseline: ChoiceBaseline) -> Option<f64> {
        Some(self.alternative(baseline)?.regret?.value)
    }
}
