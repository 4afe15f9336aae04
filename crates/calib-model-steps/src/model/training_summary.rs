//! Training of a network, in the manifest of its model.

use std::fmt;

use calib_base::output::{count, number};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Training of a network, in the manifest of its model.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub(crate) struct TrainingSummary {
    /// The library and device that did the arithmetic.
    pub(crate) backend: String,
    pub(crate) epochs: usize,
    pub(crate) updates: u64,
    /// The epoch whose weights are kept, from 1.
    pub(crate) kept_epoch: usize,
    /// Mean squared errors of that epoch, in normalised units.
    pub(crate) training_loss: f64,
    pub(crate) validation_loss: f64,
    /// The validation loss of predicting that nothing changes.
    pub(crate) persistence_loss: f64,
}

impl fmt::Display for TrainingSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "weights of epoch {} of {}, one-step validation loss {} (no change at all: {}); {}",
            count(self.kept_epoch),
            count(self.epochs),
            number(self.validation_loss),
            number(self.persistence_loss),
            self.backend,
        )
    }
}
