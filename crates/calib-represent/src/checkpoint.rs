use std::collections::BTreeMap;

use calib_files::{CheckpointFile, Tensor, Tensors};
use calib_nn::Moments;
use serde::{Deserialize, Serialize};

use crate::{Point, RepresentError, Stepper};

/// The content of a checkpoint besides parameters and moments.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Progress {
    /// Number of updates so far.
    done: usize,
    /// Loss of the first update.
    pub(crate) first_loss: Option<f64>,
    /// Sum of the losses since the latest point of the learning curve.
    pub(crate) sum: f64,
    /// Number of losses in that sum.
    pub(crate) count: usize,
    /// Adam's powers β₁ᵗ and β₂ᵗ.
    powers: (f64, f64),
    /// Points of the learning curve so far.
    pub(crate) points: Vec<Point>,
}

const PROGRESS: &str = "progress";

/// Writes the state from which `training` can resume.
pub(crate) fn write(
    file: &CheckpointFile,
    training: &dyn Stepper,
    progress: &Progress,
) -> Result<(), RepresentError> {
    let Moments { mean, square, powers } = training.moments()?;
    let tensors = vec![
        Tensor::flat("mean", mean),
        Tensor::flat("parameters", training.encoder()?.parameters().to_vec()),
        Tensor::flat("square", square),
    ];
    let progress = Progress { done: training.done(), powers, ..progress.clone() };
    let metadata = BTreeMap::from([(PROGRESS.to_owned(), serde_json::json!(progress).to_string())]);
    Ok(file.write(Tensors { tensors, metadata })?)
}

/// Restores `training` from its checkpoint. Returns `None` if there is no such checkpoint.
pub(crate) fn read(
    file: &CheckpointFile,
    training: &mut dyn Stepper,
) -> Result<Option<Progress>, RepresentError> {
    let parameter_count = training.encoder()?.parameter_count();
    let Some((progress, parameters, moments)) = parts_of(file, parameter_count) else {
        return Ok(None);
    };
    training.restore(&parameters, moments, progress.done);
    Ok(Some(progress))
}

/// Returns the parts of a checkpoint by [`write`], parameters second. Returns `None` if it belongs
/// to an encoder of another size.
fn parts_of(
    file: &CheckpointFile,
    parameter_count: usize,
) -> Option<(Progress, Vec<f32>, Moments)> {
    let content = file.read()?;
    let progress: Progress = serde_json::from_str(content.metadata.get(PROGRESS)?).ok()?;
    let [parameters, mean, square] = ["parameters", "mean", "square"].map(|name| {
        let found = content.get(name).filter(|tensor| tensor.values.len() == parameter_count);
        found.map(|tensor| tensor.values.clone())
    });
    let moments = Moments { mean: mean?, square: square?, powers: progress.powers };
    Some((progress, parameters?, moments))
}
