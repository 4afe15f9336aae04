use calib_core::{Monitor, Seed};
use calib_files::Tensors;
use serde::{Deserialize, Serialize};

use crate::{DynamicsConfig, DynamicsError, Keep};

/// Losses of one epoch: mean squared errors over transitions and columns, in normalised units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpochLoss {
    /// The loss over the mini-batches of the epoch, each before its update.
    pub training: f64,
    /// The loss over the validation part, after the epoch.
    pub validation: f64,
}

/// The history of training so far.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrainingRecord {
    /// The losses of each epoch.
    pub epochs: Vec<EpochLoss>,
    /// Number of updates so far.
    pub updates: u64,
    /// The epoch whose weights are kept, counted from 1; 0 before the first epoch.
    pub kept: usize,
}

impl TrainingRecord {
    /// Whether all epochs are done.
    pub fn is_complete(&self, config: &DynamicsConfig) -> bool {
        self.epochs.len() >= config.epochs
    }

    /// Adds an epoch. Returns whether its weights are now the ones to keep.
    ///
    /// # Errors
    /// If a loss is not finite.
    pub fn push(
        &mut self,
        loss: EpochLoss,
        config: &DynamicsConfig,
    ) -> Result<bool, DynamicsError> {
        let epoch = self.epochs.len() + 1;
        for loss in [loss.training, loss.validation] {
            if !loss.is_finite() {
                let learning_rate = config.learning_rate;
                return Err(DynamicsError::Diverged { epoch, loss, learning_rate });
            }
        }
        let best = self.epochs.iter().map(|epoch| epoch.validation).fold(f64::INFINITY, f64::min);
        let kept = config.keep == Keep::Last || loss.validation < best;
        self.epochs.push(loss);
        if kept {
            self.kept = epoch;
        }
        Ok(kept)
    }
}

/// The training of a model, epoch by epoch.
///
/// An epoch is a pure function of the state before it. So training that is saved in a
/// [`checkpoint`](Self::checkpoint) and resumed ends with the same bytes.
pub trait Trainer {
    /// Returns the number of updates per epoch, the unit of progress.
    fn updates_per_epoch(&self) -> usize;

    /// Returns the history of the training.
    fn record(&self) -> &TrainingRecord;

    /// Trains for one epoch. The monitor advances by its updates. The caller begins the task.
    ///
    /// # Errors
    /// [`DynamicsError::Diverged`], or [`DynamicsError::Cancelled`]. The trainer cannot be used
    /// afterwards.
    fn epoch(&mut self, monitor: &dyn Monitor) -> Result<EpochLoss, DynamicsError>;

    /// Returns the full state, from which the next epoch follows.
    ///
    /// # Errors
    /// If the weights cannot be read from their device.
    fn checkpoint(&self) -> Result<Tensors, DynamicsError>;

    /// Returns the weights that are kept.
    ///
    /// # Errors
    /// If the weights cannot be read from their device.
    fn weights(&self) -> Result<Tensors, DynamicsError>;
}

/// Returns the order of the training items in epoch `epoch` (from 0). It is the same for every backend.
pub(crate) fn epoch_order(items: impl Iterator<Item = u32>, seed: Seed, epoch: usize) -> Vec<u32> {
    let mut order: Vec<u32> = items.collect();
    seed.child("epoch").number(epoch as u64).rng().shuffle(&mut order);
    order
}

/// Returns the seed of the initial parameters. It is the same for every backend.
pub fn seed_of_parameters(seed: Seed) -> Seed {
    seed.child("parameters")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_or_the_last_epoch_is_kept() {
        let losses = [3.0, 1.0, 2.0, 1.0];
        for (keep, expected) in [(Keep::Best, 2), (Keep::Last, 4)] {
            let config = DynamicsConfig { keep, epochs: 4, ..DynamicsConfig::default() };
            let mut record = TrainingRecord::default();
            for validation in losses {
                assert!(!record.is_complete(&config));
                record.push(EpochLoss { training: 0.5, validation }, &config).expect("finite");
            }
            assert!(record.is_complete(&config));
            assert_eq!(record.kept, expected);
        }
        let loss = EpochLoss { training: f64::NAN, validation: 1.0 };
        let error = TrainingRecord::default().push(loss, &DynamicsConfig::default());
        assert!(error.expect_err("not finite").to_string().contains("learning_rate"));
    }
}
