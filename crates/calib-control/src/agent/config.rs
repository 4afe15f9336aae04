use std::{fmt, ops::RangeInclusive};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Tiles;
use crate::{ControlError, error::check_fields};

/// How an agent that acts learns and chooses actions. Every field can be swept.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AgentConfig {
    /// The learning algorithm.
    pub algorithm: Algorithm,
    /// Step size α of Adam. For tile coding it is divided by the number of tilings: each weight has α / tilings.
    pub step_size: f64,
    /// Adam's β₁; 0 for no momentum.
    pub beta1: f64,
    /// Temperature of the softmax policy, in units of return; for `expected_sarsa` only.
    pub temperature: f64,
    /// Probability of a random action; not for `expected_sarsa`.
    pub epsilon: f64,
    /// Weights start at this number divided by the number of tilings. So values start at this number times d + d(d − 1)/2 for d columns of
    /// the state, or times d without pairs. The values of a network start near this number. Larger numbers make an agent explore.
    pub initial_weight: f64,
    /// Decay λ of the eligibility traces; for `expected_sarsa` only.
    pub lambda: f64,
    /// Discount factor γ.
    pub gamma: f64,
    /// Number of tilings; not for `deep_q_learning`.
    pub tilings: usize,
    /// Tiles of each column in a tiling; not for `deep_q_learning`.
    pub tiles: usize,
    /// Whether pairs of columns have tiles in addition to single columns, `tiles`² for each pair and tiling; not for `deep_q_learning`.
    pub pairs: bool,
    /// Units of each hidden layer of the network; this key and those below are for `deep_q_learning` only.
    pub hidden_width: usize,
    /// Hidden layers.
    pub hidden_layers: usize,
    /// Transitions of a batch; the agent learns from one batch per step.
    pub batch: usize,
    /// Capacity of the replay buffer: batches are sampled from this many of the latest transitions.
    pub replay: usize,
    /// Steps between updates of the target network.
    pub target_steps: usize,
}

/// The learning algorithm of an agent that acts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Algorithm {
    /// Expected Sarsa(λ) with replacing traces and a softmax policy: the target is the mean over the policy's next action.
    #[default]
    ExpectedSarsa,
    /// Q-learning with an ε-greedy policy: the target is the best next action. It has no traces.
    QLearning,
    /// Q-learning with a multilayer perceptron, experience replay and a target network.
    DeepQLearning,
}

impl Algorithm {
    /// Returns the name in a study.
    pub fn name(self) -> &'static str {
        match self {
            Self::ExpectedSarsa => "expected_sarsa",
            Self::QLearning => "q_learning",
            Self::DeepQLearning => "deep_q_learning",
        }
    }

    /// Returns whether an agent with this algorithm uses the field.
    pub fn uses(self, field: &str) -> bool {
        match field {
            "temperature" | "lambda" => self == Self::ExpectedSarsa,
            "epsilon" => self != Self::ExpectedSarsa,
            "tilings" | "tiles" | "pairs" => self != Self::DeepQLearning,
            "hidden_width" | "hidden_layers" | "batch" | "replay" | "target_steps" => {
                self == Self::DeepQLearning
            }
            _ => true,
        }
    }
}

impl fmt::Display for Algorithm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
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
            pairs: true,
            hidden_width: 64,
            hidden_layers: 2,
            batch: 32,
            replay: 10_000,
            target_steps: 200,
        }
    }
}

impl AgentConfig {
    /// Checks that every field has a valid value.
    ///
    /// # Errors
    /// If a field is not valid. The error names the first one and its valid values.
    pub fn check(&self) -> Result<(), ControlError> {
        let checks = [
            ("step_size", self.step_size, is_positive(self.step_size), "a positive number"),
            ("beta1", self.beta1, (0.0..1.0).contains(&self.beta1), "from 0 to below 1"),
            ("temperature", self.temperature, is_positive(self.temperature), "a positive number"),
            ("epsilon", self.epsilon, is_share(self.epsilon), "from 0 to 1"),
            (
                "initial_weight",
                self.initial_weight,
                self.initial_weight.is_finite(),
                "a finite number",
            ),
            ("lambda", self.lambda, is_share(self.lambda), "from 0 to 1"),
            ("gamma", self.gamma, is_share(self.gamma), "from 0 to 1"),
            ("tilings", self.tilings as f64, (1..=64).contains(&self.tilings), "from 1 to 64"),
            ("tiles", self.tiles as f64, (1..=64).contains(&self.tiles), "from 1 to 64"),
            whole("hidden_width", self.hidden_width, &(1..=4096), "from 1 to 4096"),
            whole("hidden_layers", self.hidden_layers, &(0..=8), "from 0 to 8"),
            whole("batch", self.batch, &(1..=4096), "from 1 to 4096"),
            whole("replay", self.replay, &(self.batch..=10_000_000), "from batch to 10,000,000"),
            whole("target_steps", self.target_steps, &(1..=usize::MAX), "at least 1"),
        ];
        check_fields(&checks)
    }

    /// Returns the value of every action before the agent learns, in states of this many columns. For a network it is an approximate value.
    pub fn first_value(&self, columns: usize) -> f64 {
        self.initial_weight * self.initial_weights_in_value(columns)
    }

    /// Returns by how much a step changes a value at most, in states of this many columns: each weight in it moves by about the step
    /// size. A network's step size has no unit, and this number means nothing for it.
    pub fn step_of_value(&self, columns: usize) -> f64 {
        self.step_size * self.initial_weights_in_value(columns)
    }

    /// Returns the first value of an agent whose initial weight is 1: the active features per tiling, or 1 for a network.
    pub(crate) fn initial_weights_in_value(&self, columns: usize) -> f64 {
        if self.algorithm == Algorithm::DeepQLearning {
            1.0
        } else {
            self.tiling(columns).active_per_tiling() as f64
        }
    }

    /// Returns the tile coding for states of this many columns.
    pub(super) fn tiling(&self, columns: usize) -> Tiles {
        Tiles::new(self.tilings, self.tiles, columns, self.pairs)
    }
}

fn is_share(value: f64) -> bool {
    (0.0..=1.0).contains(&value)
}

fn is_positive(value: f64) -> bool {
    value > 0.0 && value.is_finite()
}

/// Returns the check of an integer field: its name, its value, whether that is in `range`, and the expected range.
fn whole(
    field: &'static str,
    value: usize,
    range: &RangeInclusive<usize>,
    expected: &'static str,
) -> (&'static str, f64, bool, &'static str) {
    (field, value as f64, range.contains(&value), expected)
}
