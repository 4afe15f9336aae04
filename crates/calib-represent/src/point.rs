use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Scores;

/// A point of the learning curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Point {
    /// Number of updates so far.
    pub step: usize,
    /// Mean loss of the updates since the previous point.
    pub loss: f64,
    /// Scores on evenly spaced validation states.
    pub scores: Scores,
}
