use calib_nn::{Mlp, Moments};

use crate::{RepresentError, Training};

/// Something that trains an encoder update by update, whatever does its arithmetic: all that [`train_with`] asks of it.
///
/// [`train_with`]: crate::train_with
pub trait Stepper {
    /// One update; the loss of its batch before the update.
    ///
    /// # Errors
    /// If the arithmetic cannot be done.
    fn step(&mut self) -> Result<f64, RepresentError>;

    /// Updates so far.
    fn done(&self) -> usize;

    /// The encoder as it is now.
    ///
    /// # Errors
    /// If it cannot be had from where it is.
    fn encoder(&self) -> Result<Mlp, RepresentError>;

    /// Adam's moments.
    ///
    /// # Errors
    /// If they cannot be had from where they are.
    fn moments(&self) -> Result<Moments, RepresentError>;

    /// Go on from where another training of the same shape was after `done` updates.
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
