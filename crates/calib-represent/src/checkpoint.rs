use std::{collections::BTreeMap, io, path::PathBuf};

use calib_files::{FileError, Tensor, Tensors, read_sealed_tensors, remove_file, write_tensors};
use calib_nn::Moments;
use serde::{Deserialize, Serialize};

use crate::{Point, RepresentError, Stepper};

/// What a checkpoint holds beside parameters and moments.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Progress {
    /// What the training follows from; a checkpoint of another key is not gone on from.
    key: String,
    /// Updates so far.
    done: usize,
    /// Loss of the first update.
    pub(crate) first_loss: Option<f64>,
    /// Sum of the losses since the latest point.
    pub(crate) sum: f64,
    /// Losses in that sum.
    pub(crate) count: usize,
    /// Adam's powers β₁ᵗ and β₂ᵗ.
    powers: (f64, f64),
    /// Points so far.
    pub(crate) points: Vec<Point>,
}

const PROGRESS: &str = "progress";

/// Where a training that may be killed keeps what it needs to go on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Checkpoint {
    /// A safetensors file; it need not exist.
    pub path: PathBuf,
    /// Names everything that the training follows from: data, hyperparameters, seed. A file that was written
    /// under another key is not gone on from, and replaced.
    pub key: String,
}

impl Checkpoint {
    /// Remove the file, once the training's results are kept elsewhere.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn remove(&self) -> Result<(), RepresentError> {
        Ok(remove_file(&self.path)?)
    }
}

/// Write all that `training` needs to go on.
pub(crate) fn write(
    Checkpoint { path, key }: &Checkpoint,
    training: &dyn Stepper,
    progress: &Progress,
) -> Result<(), RepresentError> {
    let Moments { mean, square, powers } = training.moments()?;
    let tensors = vec![
        Tensor::flat("mean", mean),
        Tensor::flat("parameters", training.encoder()?.parameters().to_vec()),
        Tensor::flat("square", square),
    ];
    let progress = Progress { key: key.clone(), done: training.done(), powers, ..progress.clone() };
    let text = serde_json::to_string(&progress).map_err(io::Error::from);
    let text = text.map_err(|source| FileError::io("write", path, source))?;
    let metadata = BTreeMap::from([(PROGRESS.to_owned(), text)]);
    Ok(write_tensors(path, &Tensors { tensors, metadata })?)
}

/// Put `training` where the checkpoint at `path` stopped. `None` if there is no file.
pub(crate) fn read(
    Checkpoint { path, key }: &Checkpoint,
    training: &mut dyn Stepper,
) -> Result<Option<Progress>, RepresentError> {
    if !path.exists() {
        return Ok(None);
    }
    let refuse = |reason: String| RepresentError::Checkpoint { path: path.clone(), reason };
    let content = read_sealed_tensors(path)?;
    let text = content.metadata.get(PROGRESS).ok_or_else(|| refuse("no progress".to_owned()))?;
    let progress: Progress =
        serde_json::from_str(text).map_err(|error| refuse(error.to_string()))?;
    if progress.key != *key {
        // Of another study or other data: training begins anew and replaces it.
        return Ok(None);
    }
    let expected = training.encoder()?.parameter_count();
    let values = |name: &str| {
        let found = content.get(name).filter(|tensor| tensor.values.len() == expected);
        found.map(|tensor| tensor.values.clone()).ok_or_else(|| refuse(format!("`{name}`")))
    };
    let (parameters, mean, square) = (values("parameters")?, values("mean")?, values("square")?);
    training.restore(&parameters, Moments { mean, square, powers: progress.powers }, progress.done);
    Ok(Some(progress))
}
