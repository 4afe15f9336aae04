//! What to deploy, and how well that is supported.

use calib_agent::SimplePredictor;
use calib_stats::{Bounded, Estimate};

use super::{ChoiceBaseline, Grade, SimpleRow, Simpler};
use crate::Setting;

/// The value a calibration model chose for one sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct Verdict {
    /// The predicted sensor.
    pub sensor: String,
    /// The swept hyperparameter, as in the study file.
    pub field: String,
    /// The calibration model that chose, or "log replay" without one.
    pub model: String,
    /// Its choice.
    pub chosen: Setting,
    /// How well held-out data supports it.
    pub grade: Grade,
    /// How it was chosen.
    pub reason: Reason,
    /// Whether what it was chosen from prefers any value to another.
    pub evidence: Separation,
    /// All values that share the smallest worst rank, in grid order.
    pub tie_set: Vec<Setting>,
    /// The worst rank of the choice; 1 = best in every member, 0 without a model.
    pub worst_rank: usize,
    /// Number of values.
    pub values: usize,
    /// Number of members of the ensemble; 0 without a model.
    pub members: usize,
    /// What other draws of members, runs and windows of the log choose, with their shares; the most frequent first.
    pub stability: Vec<(Setting, f64)>,
    /// How many of these draws choose the same value or one next to it on the grid; none where that says nothing.
    pub stability_nearby: Option<f64>,
    /// Share of the held-out values outside of the range that was learned from; none where it is not known.
    pub outside_training: Option<f64>,
    /// How far held-out values lie from the training mean, in spreads of the training range, where that is so far that nothing was
    /// learned of such values.
    pub elsewhere: Option<f64>,
    /// How the choice did Online; `None` if no data was held out.
    pub online: Option<HeldOutResult>,
    /// Other ways to choose, and what they would have cost.
    pub alternatives: Vec<Alternative>,
    /// Simple predictors on the same held-out windows, the simplest first; empty where they are not known.
    pub simple: Vec<SimpleRow>,
    /// The simple predictor to use instead of the agent, if the agent is not known to match it.
    pub simpler: Option<Simpler>,
    /// The simple predictor that the log prefers, where the agent is known to match it.
    pub matched: Option<Simpler>,
    /// The simple predictor to use because further learning adds nothing: the choice is that and learns nothing, or it is not shown
    /// to improve by a hundredth on a default that is.
    pub frozen: Option<SimplePredictor>,
    /// Whether that is the choice itself, which learns nothing then: what it gains on the default is no gain by learning.
    pub learns_nothing: bool,
    /// What would be chosen by each part of the runs.
    pub parts: Vec<PartRow>,
    /// Share of the choice's squared error on held-out data that is made in the first tenth of its runs.
    pub start_up_share: Option<f64>,
    /// What the reader must know before relying on this verdict: [`super::caveats`].
    pub notes: Vec<String>,
}

/// What would be chosen by the errors over a part of each run.
#[derive(Debug, Clone, PartialEq)]
pub struct PartRow {
    /// The part in words: "whole run".
    pub part: &'static str,
    /// What is chosen by it.
    pub chosen: Setting,
    /// Mean score of the verdict's choice over that part of held-out runs.
    pub error: Option<f64>,
}

/// Whether errors tell the values of the grid apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Separation {
    /// Some value has a smaller error than another.
    Apart,
    /// All values have the same error.
    Alike,
}

/// What streams a choice by logarithms is made from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sources {
    /// Those of the members alone.
    Members,
    /// Those of the replayed log as well.
    MembersAndLog,
    /// Those of the replayed log alone: there is no model.
    Log,
}

/// What a choice is the best by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reason {
    /// The smallest worst rank over members.
    WorstRank,
    /// The smallest mean rank over ensemble members.
    MeanRank,
    /// The smallest mean error over ensemble members.
    MeanError,
    /// The smallest mean logarithm of the error over so many streams of the members.
    MeanLogError {
        /// Streams.
        streams: usize,
    },
    /// The same over the streams of members and of the replayed log.
    Pooled {
        /// Streams.
        streams: usize,
        /// What they are of.
        sources: Sources,
    },
    /// The same over the windows of the replayed log alone.
    LogReplay {
        /// Windows.
        streams: usize,
    },
    /// The default is left only for a value that is better by more than a standard error over so many streams.
    OneStandardError {
        /// Streams.
        streams: usize,
        /// What they are of.
        sources: Sources,
    },
}

/// The choice, judged by held-out data.
#[derive(Debug, Clone, PartialEq)]
pub struct HeldOutResult {
    /// What was judged: "over the whole run".
    pub part: String,
    /// Windows of the held-out range that were replayed.
    pub windows: usize,
    /// Runs over all of them.
    pub runs: usize,
    /// Whether the errors of different values differ.
    pub values: Separation,
    /// Whether the sensor has one value throughout every window, so that there was nothing to predict.
    pub stands_still: bool,
    /// Mean Online score of the choice; infinite if it diverged.
    pub chosen_error: f64,
    /// 1 − RMSE / standard deviation of the returns; 0 is the error of predicting the mean.
    pub chosen_skill: Option<f64>,
    /// The best value over all windows.
    pub best: Setting,
    /// Its mean Online score.
    pub best_error: f64,
    /// Its skill.
    pub best_skill: Option<f64>,
    /// exp(mean over windows of ln(error / best error of the window)) − 1; `None` where it is undefined.
    pub regret: Option<Bounded>,
    /// Error of the choice by that of the default, geometric mean over windows; `None` where it is the default.
    pub against_default: Option<Estimate>,
    /// Spearman correlation between the model's ranking and Online's; `None` where it is undefined.
    pub spearman: Option<f64>,
    /// Kendall's τ-b between them.
    pub kendall: Option<f64>,
    /// Whether the choice is among the k best Online.
    pub top_k: Option<TopK>,
}

/// Whether the choice is among the `k` best values Online.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopK {
    /// How many values count as best.
    pub k: usize,
    /// Whether the choice is one of them.
    pub hit: bool,
}

/// Another way to choose, and what it would have cost.
#[derive(Debug, Clone, PartialEq)]
pub struct Alternative {
    /// Which one.
    pub baseline: ChoiceBaseline,
    /// The value it would have chosen, where it is one.
    pub value: Option<Setting>,
    /// Its regret Online; `None` without Online.
    pub regret: Option<Bounded>,
}

impl Verdict {
    /// Whether a calibration model had a part in it; else the replayed log decided alone.
    pub(crate) const fn has_model(&self) -> bool {
        self.members > 0
    }

    /// Another way to choose.
    pub fn alternative(&self, baseline: ChoiceBaseline) -> Option<&Alternative> {
        self.alternatives.iter().find(|alternative| alternative.baseline == baseline)
    }

    /// The regret of the choice, where it is known.
    pub(crate) fn regret(&self) -> Option<f64> {
        Some(self.online.as_ref()?.regret?.value)
    }

    /// The regret of another way to choose, where it is known.
    pub(crate) fn regret_of(&self, baseline: ChoiceBaseline) -> Option<f64> {
        Some(self.alternative(baseline)?.regret?.value)
    }
}
