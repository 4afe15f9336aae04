use std::ops::Range;

use calib_core::{Seed, Stream};
use calib_nn::{AdamRule, Optimiser, SgdRule};

use crate::{AgentConfig, OptimiserKind, checkpointer::ValueState};

/// The transitions of one update, identified by the steps they start from.
#[derive(Clone, Copy)]
pub(crate) struct Batch<'a> {
    pub(crate) stream: &'a dyn Stream,
    pub(crate) starts: &'a [usize],
    /// The step whose prediction must be recorded before this update, if that is still to do.
    pub(crate) present: Option<usize>,
}

/// The result of one agent's update.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Learned {
    /// The value of the present state before the update, if the batch asks for it.
    pub(crate) prediction: Option<f32>,
    /// Sum of the squared TD errors of the batch.
    pub(crate) squared_errors: f32,
    /// Whether every TD error was finite.
    pub(crate) finite: bool,
}

/// The value functions of a population: agents of one kind and shape that learn from the same batches.
///
/// The results of an agent do not depend on the other agents of the population.
pub(crate) trait Values: Send {
    /// Returns v(state) of one agent.
    fn predict(&mut self, agent: usize, state: &[f32]) -> f32;

    /// Appends v of the states at `steps` of a stream to `values`.
    fn predict_all(
        &mut self,
        agent: usize,
        stream: &dyn Stream,
        steps: Range<usize>,
        values: &mut Vec<f32>,
    ) {
        values.extend(steps.map(|t| self.predict(agent, stream.state(t))));
    }

    /// Makes one semi-gradient step of each agent in `live` on the same batch. `learned[i]` is the
    /// result of `live[i]`. The loss is the mean of ½δ², with the target held fixed. Without replay, one
    /// step of gradient descent is therefore the textbook's `θ ← θ + α δ ∇v(s_t)`.
    fn learn(&mut self, batch: Batch<'_>, live: &[usize], learned: &mut [Learned]);

    fn state(&self, agent: usize) -> ValueState;

    /// Continues from `state`, which fits the agent's shape. Absent moments start from zero; an absent
    /// target network is a copy of the network.
    fn restore(&mut self, agent: usize, state: &ValueState);

    /// Whether all parameters of one agent are finite.
    fn is_finite(&self, agent: usize) -> bool;
}

/// Returns the seed of initial parameters, the same for all agents of a run.
pub(crate) fn parameter_seed(seed: Seed) -> Seed {
    seed.child("parameters")
}

pub(crate) fn optimiser(config: &AgentConfig, parameters: usize) -> Optimiser {
    match config.optimiser {
        OptimiserKind::Adam => Optimiser::adam(
            AdamRule {
                learning_rate: config.learning_rate,
                beta1: config.beta1,
                beta2: config.beta2,
                epsilon: config.epsilon,
                weight_decay: config.weight_decay,
            },
            parameters,
        ),
        // Optimisers with eligibility traces make their own steps.
        OptimiserKind::Sgd | OptimiserKind::TrueOnlineTd | OptimiserKind::SwiftTd => {
            Optimiser::sgd(SgdRule {
                learning_rate: config.learning_rate,
                weight_decay: config.weight_decay,
            })
        }
    }
}

/// Counts updates and decides when the target network is copied.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TargetClock {
    period: usize,
    updates: usize,
}

impl TargetClock {
    pub(crate) fn new(period: usize) -> Self {
        Self { period, updates: 0 }
    }

    pub(crate) fn updates(self) -> usize {
        self.updates
    }

    pub(crate) fn set_updates(&mut self, updates: usize) {
        self.updates = updates;
    }

    pub(crate) fn is_on(self) -> bool {
        self.period > 0
    }

    /// Counts one update, and returns whether a copy is due after it.
    pub(crate) fn tick(&mut self) -> bool {
        self.updates += 1;
        self.is_on() && self.updates.is_multiple_of(self.period)
    }
}
