use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The environment in which agents are trained.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum EnvironmentId {
    /// A member of the calibration model's ensemble.
    Member(usize),
    /// The held-out log, replayed in time order. The choice of a setting is judged on it.
    Online,
    /// The training log, replayed: the alternative to a calibration model.
    LogReplay,
}

impl fmt::Display for EnvironmentId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Member(member) => write!(f, "member:{member}"),
            Self::Online => f.write_str("online"),
            Self::LogReplay => f.write_str("log-replay"),
        }
    }
}
