//! Training between two epochs, whatever it computes with.

use std::collections::BTreeMap;

use calib_core::{Monitor, Seed};
use calib_files::{Tensor, Tensors};
use calib_nn::Moments;

use crate::{DynamicsError, TrainingRecord, record::epoch_order};

/// Text of a checkpoint that holds everything but arrays.
const PROGRESS: &str = "progress";

/// All that a training needs to go on: what a checkpoint holds, of every [`Trainer`](crate::Trainer).
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingState {
    /// The parameters as they are.
    pub parameters: Vec<f32>,
    /// Those of the epoch that is kept.
    pub kept: Vec<f32>,
    /// Adam's moments and powers.
    pub moments: Moments,
    /// The epochs so far.
    pub record: TrainingRecord,
}

impl TrainingState {
    /// The state as a checkpoint.
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

    /// The state of a checkpoint of a network with `count` parameters.
    ///
    /// # Errors
    /// If the checkpoint is not one of such a training.
    pub fn from_tensors(checkpoint: &Tensors, count: usize) -> Result<Self, DynamicsError> {
        let array = |name: &str| match checkpoint.get(name) {
            Some(found) if found.values.len() == count => Ok(found.values.clone()),
            _ => Err(wrong("the checkpoint is of another network")),
        };
        let progress = checkpoint.metadata.get(PROGRESS).map(|text| serde_json::from_str(text));
        let Some(Ok((record, powers))) = progress else {
            return Err(wrong("the checkpoint does not say how far it went"));
        };
        let mean = array("adam.mean")?;
        let square = array("adam.square")?;
        Ok(Self {
            parameters: array("parameters")?,
            kept: array("kept")?,
            moments: Moments { mean, square, powers },
            record,
        })
    }
}

fn wrong(reason: &str) -> DynamicsError {
    DynamicsError::Weights { reason: reason.to_owned() }
}

/// One pass over `items`, transitions or first ones of sequences, in the order of the epoch: `update` is called with each
/// mini-batch and returns its loss before the update. The mean of the losses over the items.
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
