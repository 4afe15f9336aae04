use std::fmt;

use crate::DynamicsError;

/// Number of rollouts that take a step with one matrix product.
///
/// Every product has this many rows, even if fewer rollouts are needed. So a rollout is bit-identical alone and
/// among others.
pub const LANES: usize = 16;

/// A model of the plant's dynamics: states in, next states out, in normalised units.
pub trait Dynamics: fmt::Debug + Send + Sync {
    /// Returns the number of values in a state.
    fn columns(&self) -> usize;

    /// Returns how many recorded states before its start a rollout may use to fill the hidden state; 0 for models
    /// without one.
    fn history(&self) -> usize;

    /// Begins [`LANES`] rollouts with empty hidden states.
    ///
    /// # Errors
    /// If the model cannot be run.
    fn begin_rollouts(&self) -> Result<Box<dyn LaneRollouts + '_>, DynamicsError>;
}

/// [`LANES`] rollouts in progress.
pub trait LaneRollouts {
    /// Writes the states that follow `states`, both `[LANES, columns]`, and updates the hidden states.
    ///
    /// # Errors
    /// If the model cannot be run. Values that are not finite are not an error here.
    fn step(&mut self, states: &[f32], next: &mut [f32]) -> Result<(), DynamicsError>;

    /// Empties the hidden state of one lane.
    fn forget(&mut self, lane: usize);
}
