//! Agents that act. Their action values are linear in tile coding, or come from a network.

mod arrays;
mod config;
mod linear;
mod memory;
mod network;
mod policies;
mod stored;
mod tiles;
mod weights;

use calib_core::{Rng, Seed};

pub use config::{AgentConfig, Algorithm};
use linear::Linear;
use network::Network;
use policies::policy;
pub(crate) use tiles::Tiles;

use crate::Outcome;

/// An agent that acts, and learns from the outcomes of its actions.
///
/// After (s, a, r, s') the error of its values q is δ = r + γ v(s') − q(s, a), and v is 0 after a terminal. v(s') is the mean of q(s', ·)
/// under the policy (Expected Sarsa) or its maximum (Q-learning). Values are linear in tile coding, or come from a network that learns from
/// replayed transitions.
#[derive(Clone, Debug)]
pub struct Agent {
    config: AgentConfig,
    actions: usize,
    learner: Learner,
    /// q of the present state.
    values: Vec<f64>,
    policy: Vec<f64>,
}

#[derive(Clone, Debug)]
enum Learner {
    Linear(Box<Linear>),
    Network(Box<Network>),
}

impl Agent {
    /// Returns an untrained agent for states of this many columns. Only networks start from random values, here always with the same seed.
    pub fn new(config: AgentConfig, columns: usize, actions: usize) -> Self {
        Self::seeded(config, columns, actions, Seed::new(0))
    }

    /// Returns an untrained agent. `seed` determines the first weights of a network, and the transitions that it replays.
    pub fn seeded(config: AgentConfig, columns: usize, actions: usize, seed: Seed) -> Self {
        let learner = match config.algorithm {
            Algorithm::DeepQLearning => {
                Learner::Network(Box::new(Network::new(&config, columns, actions, seed)))
            }
            Algorithm::ExpectedSarsa | Algorithm::QLearning => {
                Learner::Linear(Box::new(Linear::new(&config, columns, actions)))
            }
        };
        let none = vec![0.0; actions];
        Self { config, actions, learner, values: none.clone(), policy: none }
    }

    /// Starts an episode in `state`.
    pub fn look(&mut self, state: &[f32]) {
        if let Learner::Linear(linear) = &mut self.learner {
            linear.forget();
        }
        self.go_on(state);
    }

    /// Draws an action in the present state. Returns `None` if the agent has diverged.
    pub fn act(&mut self, rng: &mut Rng) -> Option<usize> {
        if !self.values.iter().all(|value| value.is_finite()) {
            return None;
        }
        policy(&self.config, &self.values, &mut self.policy);
        let mut left = rng.unit();
        for (action, probability) in self.policy.iter().enumerate() {
            if left < *probability {
                return Some(action);
            }
            left -= probability;
        }
        // Rounding can leave a rest after the last action; then the last action with a positive probability is meant.
        self.policy.iter().rposition(|&probability| probability > 0.0)
    }

    /// Returns the probability of each action in the present state.
    pub fn policy(&mut self) -> &[f64] {
        policy(&self.config, &self.values, &mut self.policy);
        &self.policy
    }

    /// Returns the value of each action in the present state.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Returns the value of each action in `state`. The present state does not change.
    pub fn values_in(&self, state: &[f32]) -> Vec<f64> {
        let mut values = vec![0.0; self.actions];
        match &self.learner {
            Learner::Linear(learner) => learner.values_in(state, &mut values),
            Learner::Network(learner) => learner.values_in(state, &mut values),
        }
        values
    }

    /// Learns from the outcome of `action`, and moves to `next`.
    pub fn learn(&mut self, action: usize, outcome: Outcome, next: &[f32]) {
        let Self { config, values, .. } = self;
        match &mut self.learner {
            Learner::Linear(learner) => learner.learn(config, action, outcome, next, values),
            Learner::Network(learner) => learner.learn(config, action, outcome, next, values),
        }
    }

    /// Moves to `next` without learning.
    pub fn go_on(&mut self, next: &[f32]) {
        match &mut self.learner {
            Learner::Linear(learner) => learner.go_on(next, &mut self.values),
            Learner::Network(learner) => learner.go_on(next, &mut self.values),
        }
    }

    /// Returns the number of actions.
    pub fn actions(&self) -> usize {
        self.actions
    }
}

#[cfg(test)]
mod tests;
