use calib_files::{Tensor, Tensors};

use super::{
    AgentConfig, Algorithm, Tiles,
    arrays::{progress, progress_of, values_of},
    policies::policy,
    weights::{Change, Weights},
};
use crate::{ControlError, Ending, Outcome};

/// Values that are linear in tile coding: q(s, a) = Σ of the weights of action a's features in s. A step sets the traces of the features of
/// (s, a) to 1. Adam then changes all weights that have a trace, with −δe as the gradient.
#[derive(Clone, Debug)]
pub(super) struct Linear {
    tiles: Tiles,
    weights: Weights,
    /// Features of the present state, and of the next one.
    here: Vec<u32>,
    next: Vec<u32>,
    /// q of the next state, and the policy there.
    next_values: Vec<f64>,
    policy: Vec<f64>,
    /// β₁ and β₂, each to the power of the number of updates.
    powers: [f64; 2],
}

impl Linear {
    pub(super) fn new(config: &AgentConfig, columns: usize, actions: usize) -> Self {
        let tiles = config.tiling(columns);
        let weight = config.initial_weight / config.tilings as f64;
        Self {
            weights: Weights::new(actions * tiles.len(), weight as f32),
            here: Vec::with_capacity(tiles.active()),
            next: Vec::with_capacity(tiles.active()),
            tiles,
            next_values: vec![0.0; actions],
            policy: vec![0.0; actions],
            powers: [1.0; 2],
        }
    }

    pub(super) fn to_tensors(&self, actions: usize) -> Tensors {
        let shape = vec![actions, self.tiles.len()];
        let parts = ["weights", "mean", "square"].into_iter().zip(self.weights.clone().parts());
        Tensors {
            tensors: parts
                .map(|(name, values)| Tensor {
                    name: name.to_owned(),
                    shape: shape.clone(),
                    values,
                })
                .collect(),
            metadata: [progress(&self.powers)].into(),
        }
    }

    /// Takes over stored weights and moments.
    ///
    /// # Errors
    /// If the tensors belong to another agent.
    pub(super) fn restore(&mut self, tensors: &Tensors) -> Result<(), ControlError> {
        let count = self.next_values.len() * self.tiles.len();
        let [values, means, squares] =
            ["weights", "mean", "square"].map(|name| values_of(tensors, name, count));
        self.weights = Weights::with_moments(values?, means?, squares?);
        self.powers = progress_of(tensors)?;
        Ok(())
    }

    /// Ends all traces.
    pub(super) fn forget(&mut self) {
        self.weights.forget();
    }

    /// Moves to `state`, and writes its action values to `values`.
    pub(super) fn go_on(&mut self, state: &[f32], values: &mut [f64]) {
        self.tiles.put_features(state, &mut self.here);
        self.weights.sums(self.tiles.len(), &self.here, values);
    }

    pub(super) fn values_in(&self, state: &[f32], values: &mut [f64]) {
        let mut features = Vec::with_capacity(self.tiles.active());
        self.tiles.clone().put_features(state, &mut features);
        self.weights.sums(self.tiles.len(), &features, values);
    }

    /// Learns from the outcome of `action`, and moves to `next`. `values` holds the action values of the state before, and
    /// then those of `next`.
    pub(super) fn learn(
        &mut self,
        config: &AgentConfig,
        action: usize,
        outcome: Outcome,
        next: &[f32],
        values: &mut [f64],
    ) {
        self.tiles.put_features(next, &mut self.next);
        let mut target = outcome.reward;
        if outcome.ending == Ending::Continues {
            let length = self.tiles.len();
            self.weights.sums(length, &self.next, &mut self.next_values);
            target += config.gamma * self.next_value(config);
        }
        self.update(config, action, target - values[action]);
        std::mem::swap(&mut self.here, &mut self.next);
        self.weights.sums(self.tiles.len(), &self.here, values);
    }

    /// Returns v(s') from q(s', ·).
    fn next_value(&mut self, config: &AgentConfig) -> f64 {
        match config.algorithm {
            Algorithm::ExpectedSarsa => {
                policy(config, &self.next_values, &mut self.policy);
                self.policy.iter().zip(&self.next_values).map(|(p, q)| p * q).sum()
            }
            _ => self.next_values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        }
    }

    fn update(&mut self, config: &AgentConfig, action: usize, error: f64) {
        let AgentConfig { algorithm, step_size, beta1, lambda, gamma, .. } = *config;
        self.weights.trace(action * self.tiles.len(), &self.here);
        self.powers[0] *= beta1;
        self.powers[1] *= Change::BETA2;
        let decay = match algorithm {
            Algorithm::ExpectedSarsa => gamma * lambda,
            _ => 0.0,
        };
        self.weights.change(Change {
            error: error as f32,
            step: (step_size / config.tilings as f64 / (1.0 - self.powers[0])) as f32,
            beta1: beta1 as f32,
            unbias: (1.0 / (1.0 - self.powers[1])) as f32,
            decay: decay as f32,
        });
    }
}
