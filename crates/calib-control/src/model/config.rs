use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{ControlError, error::check_fields};

/// How a model with actions is built.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ActionModelConfig {
    /// The space in which distances between states are measured.
    pub distance: Distance,
    /// Neighbours k of a state, for each action.
    pub neighbors: usize,
    /// Ensemble members: each lacks one block of the log.
    pub members: usize,
    /// Quantile that sets the radius of coverage: the distance within which this share of the recorded states has a recorded state with the
    /// same action in the other blocks. A state is covered for an action up to this radius. 1 gives the largest such distance.
    pub coverage: f64,
    /// Weight of continuous actions in the distance. With 1, the whole recorded range of an action counts as much as 1 of the metric, which
    /// for `euclidean` is the range of a column of the states. With a smaller weight, neighbours are near in the state and may differ in
    /// the action. With a larger one, they have similar actions.
    pub action_weight: f64,
    /// Rule for a step that the log does not cover.
    pub pessimism: Pessimism,
}

/// Rule for a step that the log does not cover: it has no transition with that action, or none near.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Pessimism {
    /// The episode ends with the worst return, both where an action was never recorded and where no transition with it is near.
    MinimumReturn,
    /// The nearest transition is taken at any distance. Only an action that was never recorded ends the episode, with the worst return.
    /// Both cases are counted (Wang et al. 2022).
    #[default]
    Nearest,
}

/// The space in which a model measures distances between states.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Distance {
    /// The scaled states themselves.
    #[default]
    Euclidean,
    /// A Laplacian representation of the states, trained on the log by the study's `[representation]`.
    Laplacian,
}

impl Default for ActionModelConfig {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl ActionModelConfig {
    /// The default configuration.
    pub const DEFAULT: Self = Self {
        distance: Distance::Euclidean,
        neighbors: 3,
        members: 5,
        coverage: 0.95,
        action_weight: 1.0,
        pessimism: Pessimism::Nearest,
    };

    /// Checks that every field has a valid value.
    ///
    /// # Errors
    /// If a field is not valid. The error names the first one and its valid values.
    pub fn check(&self) -> Result<(), ControlError> {
        let checks = [
            ("neighbors", self.neighbors as f64, self.neighbors > 0, "at least 1"),
            ("members", self.members as f64, self.members > 1, "at least 2"),
            (
                "coverage",
                self.coverage,
                self.coverage > 0.0 && self.coverage <= 1.0,
                "above 0, up to 1",
            ),
            (
                "action_weight",
                self.action_weight,
                self.action_weight > 0.0 && self.action_weight.is_finite(),
                "a positive number",
            ),
        ];
        check_fields(&checks)
    }
}
