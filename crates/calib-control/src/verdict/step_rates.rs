//! What the steps of a choice end in and get, beside the log.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{ActionModelKind, Decisions, Run};

/// An agent that ends its episodes this many times as often as the log may do so on purpose. Our choice.
const OFTEN: f64 = 2.0;

/// Terminals and rewards of the chosen setting's steps beside those of the recorded ones. In the models they are medians over kinds of
/// models, the lower one of two.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StepRates {
    /// Share of the chosen setting's steps in the models that end an episode in a terminal.
    pub terminals_in_model: f64,
    /// The same share of the recorded steps.
    pub terminals_in_log: f64,
    /// Mean reward of its steps in the models, of finished episodes.
    pub reward_in_model: f64,
    /// Mean reward of a recorded step.
    pub reward_in_log: f64,
}

impl StepRates {
    /// Returns those of the runs of a setting.
    pub(super) fn of(runs: &[&Run], kinds: &[ActionModelKind], log: &Decisions) -> Self {
        let mut terminals = Vec::with_capacity(kinds.len());
        let mut rewards = Vec::with_capacity(kinds.len());
        for kind in kinds {
            let own = runs.iter().filter(|run| run.kind == *kind);
            let steps = own.clone().map(|run| run.coverage.steps).sum::<u64>().max(1) as f64;
            let ended: usize = own.clone().map(|run| run.terminals).sum();
            let rewarded: f64 = own.map(|run| run.mean_return * run.episodes as f64).sum();
            terminals.push(ended as f64 / steps);
            rewards.push(rewarded / steps);
        }
        Self {
            terminals_in_model: median(terminals),
            terminals_in_log: log.terminals() as f64 / log.len() as f64,
            reward_in_model: median(rewards),
            reward_in_log: log.mean_reward(),
        }
    }

    /// Returns whether episodes end at least twice as often as in the log, and steps get less reward. Their returns are then high only
    /// because episodes are short: good if a terminal is a goal, and bad if it is a failure, which no log tells.
    pub fn end_early(&self) -> bool {
        self.terminals_in_log > 0.0
            && self.terminals_in_model >= OFTEN * self.terminals_in_log
            && self.reward_in_model < self.reward_in_log
    }
}

/// Returns the median; the lower one of two. Of no values it is 0.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len().saturating_sub(1) / 2).copied().unwrap_or(0.0)
}
