//! The state of training between two epochs, for any backend.

use std::collections::BTreeMap;

use calib_core::{Monitor, Seed};
use calib_files::{Tensor, Tensors};
use calib_nn::Moments;

use crate::{DynamicsError, TrainingRecord, record::epoch_order};

/// Key of the checkpoint's text with all values but the arrays.
const PROGRESS: &str = "progress";

/// The state from which a training resumes. It is the content of a checkpoint, for every [`Trainer`](crate::Trainer).
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingState {
    /// The current parameters.
    pub parameters: Vec<f32>,
    /// The parameters of the epoch that is kept.
    pub kept: Vec<f32>,
    /// Adam's moments and powers.
    pub moments: Moments,
    /// The epochs so far.
    pub record: TrainingRecord,
}

impl TrainingState {
    /// Returns the state as a checkpoint.
    pub fn into_tensors(self) -> Tensors {
        let Moments { mean, square, powers } = self.moments;
        let progress = serde_json::json!((&self.record, powers)).to_string();
        Tensors {
            tensors: vec![
                Tensor::flat("parameters", self.parameters),
                Tensor::flat("kept", self.kept),
                Tensor::flat("adam.mean", mean),
                Tensor::flat("adam.square", square),
            ],
            metadata: BTreeMap::from([(PROGRESS.to_owned(), progress)]),
        }
    }

    /// Reads the state from a checkpoint of a network with `count` parameters.
    ///
    /// # Errors
    /// If the checkpoint does not belong to such training.
    pub fn from_tensors(checkpoint: &Tensors, count: usize) -> Result<Self, DynamicsError> {
        let progress = checkpoint.metadata.get(PROGRESS).map(|text| serde_json::from_str(text));
        let Some(Ok((record, powers))) = progress else {
            return Err(wrong("the checkpoint does not say how far it went"));
        };
        let mean = array(checkpoint, "adam.mean", count)?;
        let square = array(checkpoint, "adam.square", count)?;
        Ok(Self {
            parameters: array(checkpoint, "parameters", count)?,
            kept: array(checkpoint, "kept", count)?,
            moments: Moments { mean, square, powers },
            record,
        })
    }
}

/// Returns the `count` values of a tensor of a checkpoint.
fn array(checkpoint: &Tensors, name: &str, count: usize) -> Result<Vec<f32>, DynamicsError> {
    match checkpoint.get(name) {
        Some(found) if found.values.len() == count => Ok(found.values.clone()),
        _ => Err(wrong("the checkpoint is of another network")),
    }
}

fn wrong(reason: &str) -> DynamicsError {
    DynamicsError::Weights { reason: reason.to_owned() }
}

/// Makes one pass over `items` (transitions, or first transitions of sequences), in the order of the epoch. Calls
/// `update` with each mini-batch; it returns the loss before the update. Returns the mean loss over the items.
///
/// # Errors
/// If an update fails, or the monitor is interrupted.
pub fn pass(
    items: impl Iterator<Item = u32>,
    (seed, epoch): (Seed, usize),
    batch_size: usize,
    monitor: &dyn Monitor,
    mut update: impl FnMut(&[u32]) -> Result<f64, DynamicsError>,
) -> Result<f64, DynamicsError> {
    let order = epoch_order(items, seed, epoch);
    let mut sum = 0.0;
    for batch in order.chunks(batch_size) {
        monitor.check()?;
        sum += update(batch)? * batch.len() as f64;
        monitor.advance(1);
    }
    Ok(sum / order.len() as f64)
}
