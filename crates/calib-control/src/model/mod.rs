//! Models with actions: one exact neighbour table per action, increments, and networks.

mod build;
mod config;
mod coverage;
mod draw;
mod ensemble;
mod held_out;
mod increments;
mod neighbor_rollout;
mod network;
mod radius;
mod step;
mod store;
mod table;

use calib_core::{States, TransitionIndex};
use calib_knn::{Blocks, Weights};

pub use config::{ActionModelConfig, Distance, Pessimism};
pub use coverage::Coverage;
pub use ensemble::{ActionModelKind, Ensemble, ModelEnvironment};
pub use increments::{IncrementModel, IncrementRollout, Increments};
pub use neighbor_rollout::NeighborRollout;
pub use network::{NetworkConfig, NetworkFiles, NetworkModel, NetworkRollout, NetworkWorkplace};
pub use step::{At, Covered, Rules, Step, Target};
pub use store::{ActionModelRecord, open_action_model, write_action_model};

use table::{ActionTable, FillingTable};

use crate::Decisions;

/// The ensemble of a log's models with actions.
///
/// A step from s' with action a draws one of the k transitions with action a whose source states are nearest to s', by distance in the
/// model's metric (`Weights::Linear`). It leads to the recorded next state of that transition, with its reward and ending. Ensemble member
/// m lacks block m of the log.
///
/// Where actions are continuous ([`Settings`](crate::Settings)), a step with level u draws from the k transitions that are nearest to (s',
/// w u), whatever their setting. Distances are those of (metric, w a), and a is divided by its recorded range.
#[derive(Clone, Debug)]
pub struct ActionModel {
    log: Decisions,
    blocks: Blocks,
    /// The states in the metric of the distances.
    metric: States,
    starts: Starts,
    /// One table per ensemble member.
    tables: Vec<ActionTable>,
    start_tables: Vec<ActionTable>,
    weights: Weights,
    action_weight: f64,
    rules: Rules,
    radius: f32,
}

/// The start states of a model.
#[derive(Clone, Debug)]
pub struct Starts {
    /// The states as an agent sees them.
    pub observed: States,
    /// The same states in the metric of the model.
    pub metric: States,
}

impl ActionModel {
    /// Returns the log.
    pub fn log(&self) -> &Decisions {
        &self.log
    }

    /// Returns the distance in the model's metric up to which a recorded transition covers a state.
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// Returns the return with which an episode ends where the log does not cover a step.
    pub fn worst_return(&self) -> f64 {
        self.rules.worst_return
    }

    /// Returns the default rules for steps that the log does not cover.
    pub fn rules(&self) -> Rules {
        self.rules
    }

    /// Returns the same model with another copy of its log, which may have data that are not stored with the model, such as probabilities.
    ///
    /// # Panics
    /// If the log has another number of transitions or actions.
    #[must_use]
    pub fn with_log(self, log: Decisions) -> Self {
        let same = (log.len(), log.levels()) == (self.log.len(), self.log.levels());
        assert!(same, "a log of as many transitions and actions");
        Self { log, ..self }
    }

    /// Returns the same model under other rules.
    #[must_use]
    pub fn with_rules(self, rules: Rules) -> Self {
        Self { rules, ..self }
    }

    /// Returns the start states, as observed.
    pub fn starts(&self) -> &States {
        &self.starts.observed
    }

    /// Returns the neighbours k of a state, for each action. There are fewer only if the log has fewer transitions.
    pub fn k(&self) -> usize {
        self.tables[0].k()
    }

    /// Returns the neighbours of the state that each transition led to, `[transitions × actions, k]`, and their distances. They are
    /// transitions, nearest first. Unused places, and all places of transitions that the member lacks, hold `u32::MAX` and `+∞`.
    ///
    /// # Panics
    /// If there is no such member.
    pub fn table(&self, member: usize) -> (&[u32], &[f32]) {
        (self.tables[member].neighbors(), self.tables[member].distances())
    }

    /// Calls `each` for every recorded next state in every ensemble member that has it: with its transition, and with whether each action
    /// has a transition within the radius.
    pub(crate) fn each_within(&self, mut each: impl FnMut(TransitionIndex, &[bool])) {
        let mut within = vec![false; self.log.levels()];
        for (member, table) in self.tables.iter().enumerate() {
            for transition in self.blocks.transitions_of(member) {
                for (action, within) in within.iter_mut().enumerate() {
                    let nearest = table.list(transition.get(), action).1.first();
                    *within = nearest.is_some_and(|&distance| distance <= self.radius);
                }
                each(transition, &within);
            }
        }
    }

    /// Returns for each action the share of the recorded next states that have a transition with that action within the radius, over all
    /// ensemble members. There the log shows what the action does.
    pub fn covered(&self) -> Vec<f64> {
        let mut covered = vec![0_usize; self.log.levels()];
        let mut all = 0_usize;
        self.each_within(|_, within| {
            all += 1;
            covered.iter_mut().zip(within).for_each(|(sum, &within)| *sum += usize::from(within));
        });
        covered.into_iter().map(|sum| sum as f64 / all.max(1) as f64).collect()
    }
}

#[cfg(test)]
pub(crate) mod tests;
