//! Whose agents learn, and how calib talks to those of another program by default.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The kind of agents that learn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AgentKind {
    /// calib's own agents: TD(0) with the hyperparameters of `[agent]`.
    #[default]
    Td,
    /// The agents of the program in `agent.command`, with the hyperparameters of `[agent.parameters]`.
    External,
}

pub(super) const STATES_PER_MESSAGE: usize = 1024;
pub(super) const TIMEOUT_SECS: f64 = 60.0;
