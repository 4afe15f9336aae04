//! What representations are trained on, and the seed of their trainings.

use calib_core::{Seed, Segments, States};
use calib_data::Dataset;
use calib_files::Fingerprint;
use calib_study::Study;

/// The data that representations are trained on.
#[derive(Clone, Copy)]
pub struct Material<'a> {
    /// One row per state.
    pub states: &'a States,
    /// The segments of the states, without gaps.
    pub segments: &'a Segments,
    /// Fingerprint of states and segments.
    pub fingerprint: &'a Fingerprint,
}

impl<'a> Material<'a> {
    /// Returns the training range.
    pub(super) fn of(dataset: &'a Dataset) -> Self {
        let states = dataset.train.states();
        let segments = dataset.train.segments();
        Self { states, segments, fingerprint: &dataset.fingerprint }
    }

    pub(super) fn shape(&self) -> (usize, usize) {
        (self.states.rows(), self.states.columns())
    }
}

/// Returns the root seed of a study's representations.
pub(super) fn seed(study: &Study) -> Seed {
    Seed::new(study.seed).child("representation")
}
