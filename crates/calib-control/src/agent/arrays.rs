//! Named arrays of learned numbers.

use calib_files::{Tensor, Tensors};
use calib_nn::{LayoutError, Mlp, Moments, Naming};

use crate::ControlError;

/// The key of the metadata that holds β₁ᵗ and β₂ᵗ and, for networks, the steps since the last update of the target network.
const PROGRESS: &str = "progress";

/// Formats Adam's progress as text that keeps every digit.
pub(super) fn progress(numbers: &[f64]) -> (String, String) {
    let numbers: Vec<String> = numbers.iter().map(ToString::to_string).collect();
    (PROGRESS.to_owned(), numbers.join(" "))
}

/// Parses the text of [`progress`].
pub(super) fn progress_of<const N: usize>(tensors: &Tensors) -> Result<[f64; N], ControlError> {
    let text = tensors.metadata.get(PROGRESS).map_or("", String::as_str);
    let numbers: Option<Vec<f64>> = text.split(' ').map(|number| number.parse().ok()).collect();
    numbers.and_then(|numbers| numbers.try_into().ok()).ok_or_else(|| ControlError::NoAgent {
        reason: format!("its text `{PROGRESS}` is {text:?}, expected {N} numbers"),
    })
}

/// Returns the values of a tensor, which must have `count` of them.
pub(super) fn values_of<'t>(
    tensors: &'t Tensors,
    name: &str,
    count: usize,
) -> Result<&'t [f32], ControlError> {
    match tensors.get(name) {
        Some(Tensor { values, .. }) if values.len() == count => Ok(values),
        Some(Tensor { values, .. }) => Err(ControlError::NoAgent {
            reason: format!("`{name}` has {} numbers, expected {count}", values.len()),
        }),
        None => Err(ControlError::NoAgent { reason: format!("there is no `{name}`") }),
    }
}

/// Returns the network whose tensor names have this prefix. It must have the shape of `like`.
pub(super) fn network_of(tensors: &Tensors, prefix: &str, like: &Mlp) -> Result<Mlp, ControlError> {
    let network = Mlp::from_tensors(tensors, prefix, Naming::Layers).map_err(ControlError::from)?;
    if sizes(&network) != sizes(like) {
        let reason = format!("`{prefix}` is another network than its settings describe");
        return Err(ControlError::NoAgent { reason });
    }
    Ok(network)
}

/// Returns the inputs and outputs of each layer.
fn sizes(network: &Mlp) -> Vec<[usize; 2]> {
    network.layers().iter().map(|layer| [layer.inputs, layer.outputs]).collect()
}

/// Returns the layers of a network, with a prefix to their names.
pub(super) fn named(network: &Mlp, prefix: &str) -> Vec<Tensor> {
    let layers = network.to_tensors(Naming::Layers).into_iter();
    layers.map(|tensor| Tensor { name: format!("{prefix}{}", tensor.name), ..tensor }).collect()
}

/// Returns Adam's moments of `count` parameters.
pub(super) fn moments_of(
    tensors: &Tensors,
    count: usize,
    powers: (f64, f64),
) -> Result<Moments, ControlError> {
    Ok(Moments {
        mean: values_of(tensors, "mean", count)?.to_vec(),
        square: values_of(tensors, "square", count)?.to_vec(),
        powers,
    })
}

impl From<LayoutError> for ControlError {
    fn from(error: LayoutError) -> Self {
        Self::NoAgent { reason: error.to_string() }
    }
}
