//! An estimate with its uncertainty.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Interval;

/// A number with its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Estimate {
    /// The number; may be infinite (`null` in files for +∞).
    #[serde(with = "crate::diverged")]
    #[schemars(with = "crate::diverged::Stored")]
    pub value: f64,
    /// Its interval; none where it cannot be said.
    pub interval: Option<Interval>,
}
