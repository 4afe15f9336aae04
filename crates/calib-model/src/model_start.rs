use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{RequestedStart, StartRow, StartState};

/// Where a rollout of a calibration model starts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ModelStart {
    /// A state of an ensemble member of a neighbour model.
    State(StartState),
    /// A row of the data, for a network, which may start anywhere.
    Row(StartRow),
}

impl ModelStart {
    /// Returns the requested start state, and the distance to its replacement, if there is
    /// one.
    pub fn given(&self) -> (RequestedStart, Option<f32>) {
        match self {
            Self::State(start) => (start.wanted, start.replaced),
            Self::Row(start) => (start.wanted, start.replaced),
        }
    }
}
