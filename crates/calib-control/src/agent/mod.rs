//! Agents that act: values of actions, linear in tile coding.

mod config;
mod tiles;
mod weights;

use calib_core::Rng;

pub use config::{AgentConfig, Algorithm};
pub(crate) use tiles::Tiles;
use weights::{Change, Weights};

use crate::{Ending, Outcome};

/// An agent that acts and learns from what follows.
///
/// q(s, a) = Σ of the weights of action a's features of s. After (s, a, r, s') the error is δ = r + γ v(s') − q(s, a), v(s') being the mean of
/// q(s', ·) under the policy (Expected Sarsa) or its maximum (Q-learning), and 0 after a terminal. Traces of the features of (s, a)
/// become 1, and all weights change by Adam on −δe.
#[derive(Clone, Debug)]
pub struct Agent {
    config: AgentConfig,
    actions: usize,
    tiles: Tiles,
    weights: Weights,
    /// Features of the state that it is in, and of the one that follows.
    here: Vec<u32>,
    next: Vec<u32>,
    /// q of the state that it is in, and of the next one.
    values: Vec<f64>,
    next_values: Vec<f64>,
    policy: Vec<f64>,
    /// β₁ and β₂ to the number of updates.
    powers: [f64; 2],
}

impl Agent {
    /// An agent that has seen nothing, for states of so many columns.
    pub fn new(config: AgentConfig, columns: usize, actions: usize) -> Self {
        let tiles = Tiles::new(config.tilings, config.tiles, columns);
        let weight = config.initial_weight / config.tilings as f64;
        Self {
            config,
            actions,
            weights: Weights::new(actions * tiles.len(), weight as f32),
            here: Vec::with_capacity(tiles.active()),
            next: Vec::with_capacity(tiles.active()),
            tiles,
            values: vec![0.0; actions],
            next_values: vec![0.0; actions],
            policy: vec![0.0; actions],
            powers: [1.0; 2],
        }
    }

    /// Look at `state`, the first of an episode.
    pub fn look(&mut self, state: &[f32]) {
        self.weights.forget();
        self.tiles.of(state, &mut self.here);
        self.value_here();
    }

    /// Draw an action in the state that it is in. `None` if it has diverged.
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
        // Rounding can use up the last bit; then the last possible action is meant.
        self.policy.iter().rposition(|&probability| probability > 0.0)
    }

    /// The probability of each action in the state that it is in.
    pub fn policy(&mut self) -> &[f64] {
        policy(&self.config, &self.values, &mut self.policy);
        &self.policy
    }

    /// The value of each action in the state that it is in.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Learn from what `action` led to, and be in `next`.
    pub fn learn(&mut self, action: usize, outcome: Outcome, next: &[f32]) {
        self.tiles.of(next, &mut self.next);
        let mut target = outcome.reward;
        if outcome.ending == Ending::Continues {
            let length = self.tiles.len();
            self.weights.sums(length, &self.next, &mut self.next_values);
            target += self.config.gamma * self.next_value();
        }
        self.update(action, target - self.values[action]);
        std::mem::swap(&mut self.here, &mut self.next);
        self.value_here();
    }

    /// Be in `next` without learning.
    pub fn go_on(&mut self, next: &[f32]) {
        self.tiles.of(next, &mut self.here);
        self.value_here();
    }

    fn value_here(&mut self) {
        let length = self.tiles.len();
        self.weights.sums(length, &self.here, &mut self.values);
    }

    /// v(s') from q(s', ·).
    fn next_value(&mut self) -> f64 {
        let best = || self.next_values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        match self.config.algorithm {
            Algorithm::QLearning => best(),
            Algorithm::ExpectedSarsa => {
                policy(&self.config, &self.next_values, &mut self.policy);
                self.policy.iter().zip(&self.next_values).map(|(p, q)| p * q).sum()
            }
        }
    }

    fn update(&mut self, action: usize, error: f64) {
        let AgentConfig { algorithm, step_size, beta1, lambda, gamma, .. } = self.config;
        self.weights.trace(action * self.tiles.len(), &self.here);
        self.powers[0] *= beta1;
        self.powers[1] *= Change::BETA2;
        let decay = match algorithm {
            Algorithm::ExpectedSarsa => gamma * lambda,
            Algorithm::QLearning => 0.0,
        };
        self.weights.change(Change {
            error: error as f32,
            step: (step_size / self.config.tilings as f64 / (1.0 - self.powers[0])) as f32,
            beta1: beta1 as f32,
            unbias: (1.0 / (1.0 - self.powers[1])) as f32,
            decay: decay as f32,
        });
    }

    /// Number of actions.
    pub fn actions(&self) -> usize {
        self.actions
    }
}

/// The probability of each action from the values of all.
pub(crate) fn policy(config: &AgentConfig, values: &[f64], probabilities: &mut [f64]) {
    let best = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    match config.algorithm {
        Algorithm::ExpectedSarsa => {
            for (probability, value) in probabilities.iter_mut().zip(values) {
                *probability = ((value - best) / config.temperature).exp();
            }
        }
        Algorithm::QLearning => {
            let ties = values.iter().filter(|&&value| value == best).count().max(1) as f64;
            let random = config.epsilon / values.len() as f64;
            for (probability, value) in probabilities.iter_mut().zip(values) {
                let greedy = if *value == best { (1.0 - config.epsilon) / ties } else { 0.0 };
                *probability = random + greedy;
            }
        }
    }
    let total: f64 = probabilities.iter().sum();
    for probability in probabilities {
        *probability /= total;
    }
}

#[cfg(test)]
mod tests;
