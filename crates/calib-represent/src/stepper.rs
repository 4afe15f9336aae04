use calib_nn::{Mlp, Moments};

use crate::{RepresentError, Training};

/// A backend that trains an encoder update by update, as [`train_with`] requires.
///
/// [`train_with`]: crate::train_with
pub trait Stepper {
    /// Makes one update. Returns the loss of its batch before the update.
    ///
    /// # Errors
    /// If the computation fails.
    fn step(&mut self) -> Result<f64, RepresentError>;

    /// Returns the number of updates so far.
    fn done(&self) -> usize;

    /// Returns the current encoder.
    ///
    /// # Errors
    /// If it cannot be read from its device.
    fn encoder(&self) -> Result<Mlp, RepresentError>;

    /// Returns Adam's moments.
    ///
    /// # Errors
    /// If they cannot be read from their device.
    fn moments(&self) -> Result<Moments, RepresentError>;

    /// Restores the state of earlier training with the same shape, after `done` updates.
    fn restore(&mut self, parameters: &[f32], moments: Moments, done: usize);
}

impl Stepper for Training {
    fn step(&mut self) -> Result<f64, RepresentError> {
        Ok(Self::step(self).total)
    }

    fn done(&self) -> usize {
        Self::done(self)
    }

    fn encoder(&self) -> Result<Mlp, RepresentError> {
        Ok(Self::encoder(self).clone())
    }

    fn moments(&self) -> Result<Moments, RepresentError> {
        Ok(self.adam.moments())
    }

    fn restore(&mut self, parameters: &[f32], moments: Moments, done: usize) {
        Self::restore(self, parameters, moments, done);
    }
}
