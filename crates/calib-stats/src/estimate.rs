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
    /// Its interval; none if it cannot be computed.
    pub interval: Option<Interval>,
}
