use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::ControlError;

/// How an agent that acts learns and chooses. Every field can be swept.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AgentConfig {
    /// What it learns by.
    pub algorithm: Algorithm,
    /// Step size α of Adam, a tiling: each weight's is α / tilings.
    pub step_size: f64,
    /// Adam's β₁; 0 for no momentum.
    pub beta1: f64,
    /// Temperature of the softmax policy, in units of return; `expected_sarsa` only.
    pub temperature: f64,
    /// Probability of a random action; `q_learning` only.
    pub epsilon: f64,
    /// Weights begin at this number divided by the number of tilings: optimism, which makes it explore.
    pub initial_weight: f64,
    /// Decay λ of the traces; `expected_sarsa` only.
    pub lambda: f64,
    /// Discount γ.
    pub gamma: f64,
    /// Tilings.
    pub tilings: usize,
    /// Tiles of each column in a tiling.
    pub tiles: usize,
}

/// What an agent that acts learns by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Algorithm {
    /// Expected Sarsa(λ) with replacing traces and a softmax policy: the target is the mean over the policy's next action.
    #[default]
    ExpectedSarsa,
    /// Q-learning with an ε-greedy policy: the target is the best next action. No traces.
    QLearning,
}

impl Default for AgentConfig {
    fn default() -> Self {
        Self {
            algorithm: Algorithm::ExpectedSarsa,
            step_size: 0.03,
            beta1: 0.0,
            temperature: 10.0,
            epsilon: 0.1,
            initial_weight: 0.0,
            lambda: 0.8,
            gamma: 1.0,
            tilings: 16,
            tiles: 8,
        }
    }
}

impl AgentConfig {
    /// Whether every field can be what it is.
    ///
    /// # Errors
    /// The first field that cannot, with what it may be.
    pub fn check(&self) -> Result<(), ControlError> {
        let share = |value: f64| (0.0..=1.0).contains(&value);
        let positive = |value: f64| value > 0.0 && value.is_finite();
        let checks = [
            ("step_size", self.step_size, positive(self.step_size), "a positive number"),
            ("beta1", self.beta1, (0.0..1.0).contains(&self.beta1), "from 0 to below 1"),
            ("temperature", self.temperature, positive(self.temperature), "a positive number"),
            ("epsilon", self.epsilon, share(self.epsilon), "from 0 to 1"),
            (
                "initial_weight",
                self.initial_weight,
                self.initial_weight.is_finite(),
                "a finite number",
            ),
            ("lambda", self.lambda, share(self.lambda), "from 0 to 1"),
            ("gamma", self.gamma, share(self.gamma), "from 0 to 1"),
            ("tilings", self.tilings as f64, (1..=64).contains(&self.tilings), "from 1 to 64"),
            ("tiles", self.tiles as f64, (1..=64).contains(&self.tiles), "from 1 to 64"),
        ];
        match checks.into_iter().find(|check| !check.2) {
            Some((field, got, _, expected)) => Err(ControlError::Field { field, got, expected }),
            None => Ok(()),
        }
    }
}
