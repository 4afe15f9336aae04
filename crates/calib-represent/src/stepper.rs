use calib_nn::Mlp;

use crate::{RepresentError, Training};

/// Means of gradients and of their squares, and (β₁ᵗ, β₂ᵗ).
pub type Moments = (Vec<f32>, Vec<f32>, (f64, f64));

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
        let (mean, square, powers) = self.adam.moments();
        Ok((mean.to_vec(), square.to_vec(), powers))
    }

    fn restore(&mut self, parameters: &[f32], (mean, square, powers): Moments, done: usize) {
        Self::restore(self, parameters, mean, square, powers, done);
    }
}
