//! A calibration model that several objects of Python share.

use calib_core::States;
use calib_knn::{KnnModel, Weights};
use calib_pipeline::Calibration;
use pyo3::prelude::*;

use crate::lost::LostPages;

/// A model, from a folder or from arrays.
pub(crate) enum SharedModel {
    /// A model with mapped states and tables, and the number of lost pages when it was opened.
    Stored(Box<Calibration>, LostPages),
    /// A model in memory.
    Built { knn: Box<KnnModel>, weights: Weights },
}

impl SharedModel {
    pub(crate) fn knn(&self) -> &KnnModel {
        match self {
            Self::Stored(model, _) => model.knn(),
            Self::Built { knn, .. } => knn,
        }
    }

    /// Returns the normalised states. If there is a representation, distances are measured in it instead.
    pub(crate) fn states(&self) -> &States {
        match self {
            Self::Stored(model, _) => model.frames().states(),
            Self::Built { knn, .. } => knn.states(),
        }
    }

    pub(crate) fn weights(&self) -> Weights {
        match self {
            Self::Stored(model, _) => model.weights(),
            Self::Built { weights, .. } => *weights,
        }
    }

    /// Returns the time of a row in microseconds, or its number if there are no times.
    pub(crate) fn time(&self, row: usize) -> i64 {
        match self {
            Self::Stored(model, _) => model.frames().timestamps()[row].as_micros(),
            Self::Built { .. } => row as i64,
        }
    }

    pub(crate) fn stored(&self) -> Option<&Calibration> {
        match self {
            Self::Stored(model, _) => Some(model),
            Self::Built { .. } => None,
        }
    }

    /// Refuses a model of which pages were lost.
    pub(crate) fn check(&self, py: Python<'_>) -> PyResult<()> {
        match self {
            Self::Stored(_, lost_pages) => lost_pages.check(py),
            Self::Built { .. } => Ok(()),
        }
    }
}
