//! One representation of a grid.

use calib_represent::{Divergence, LaplacianConfig, Point, Scores};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The file of an encoder.
pub(super) const ENCODER: &str = "encoder.safetensors";

/// One candidate representation.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub(crate) struct Candidate {
    /// Hyperparameters; none for an imported representation.
    pub(crate) config: Option<LaplacianConfig>,
    /// Directory of its encoder, below `candidates/`; none for an imported representation.
    pub(crate) directory: Option<String>,
    /// Scores; none if its training diverged.
    pub(crate) scores: Option<Scores>,
    pub(crate) divergence: Option<Divergence>,
    /// The learning curve.
    pub(crate) points: Vec<Point>,
}
