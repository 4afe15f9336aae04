use std::fmt;

use crate::DynamicsError;

/// Rollouts that are taken one step in one matrix product.
///
/// Every product has this many rows, whether so many rollouts are wanted or not: then a rollout is the same to the
/// bit alone and among others.
pub const LANES: usize = 16;

/// A model of the plant's dynamics: states in, next states out, in normalised units.
pub trait Dynamics: fmt::Debug + Send + Sync {
    /// Values in a state.
    fn columns(&self) -> usize;

    /// How many recorded states before its start a rollout may see to fill the hidden state; 0 for models without.
    fn history(&self) -> usize;

    /// Begin [`LANES`] rollouts with empty hidden states.
    ///
    /// # Errors
    /// If the model cannot be run.
    fn walk(&self) -> Result<Box<dyn Walk + '_>, DynamicsError>;
}

/// [`LANES`] rollouts in progress.
pub trait Walk {
    /// Write the states that follow `states`, both `[LANES, columns]`, and move the hidden states on.
    ///
    /// # Errors
    /// If the model cannot be run. Values that are not finite are no error here.
    fn step(&mut self, states: &[f32], next: &mut [f32]) -> Result<(), DynamicsError>;

    /// Empty the hidden state of one lane.
    fn forget(&mut self, lane: usize);
}
