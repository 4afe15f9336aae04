//! What is done through libtorch, and what is said where it is not there.

use anyhow::{bail, ensure};
use calib_agent::Accelerator;
use calib_core::{Monitor, Seed};
use calib_dynamics::{Dynamics, DynamicsConfig, Trainer, Transitioning};
use calib_files::{Tensors, Unfinished};
use calib_knn::ModelKind;
use calib_represent::{LaplacianConfig, Task, Trained};

use crate::base::options::Device;

/// What wants libtorch in a calib that was built without it.
#[derive(Debug, thiserror::Error)]
#[error(
    "{0} wants libtorch, and this calib was built without it; in the source tree run \
     `bash scripts/libtorch.sh cargo build --release --features torch`"
)]
pub(crate) struct NoLibtorch(String);

fn wanted(what: &str) -> NoLibtorch {
    NoLibtorch(what.to_owned())
}

/// Check that this program has libtorch, or say that `what` wants it.
pub(crate) fn require(what: &str) -> anyhow::Result<()> {
    ensure!(cfg!(feature = "torch"), wanted(what));
    Ok(())
}

/// A trainer of a network on a device, going on from a checkpoint if there is one, and what it computes with.
#[cfg(feature = "torch")]
pub(crate) fn trainer(
    kind: ModelKind,
    data: &Transitioning<'_>,
    config: &DynamicsConfig,
    seed: Seed,
    device: Device,
    checkpoint: Option<&Tensors>,
) -> anyhow::Result<(Box<dyn Trainer>, String)> {
    use calib_torch::{FeedForwardTrainer, RecurrentTrainer};
    let device = calib_torch::device(choice(device))?;
    let trainer: Box<dyn Trainer> = match (kind, checkpoint) {
        (ModelKind::Nn, None) => Box::new(FeedForwardTrainer::new(data, config, seed, device)),
        (ModelKind::Nn, Some(found)) => {
            Box::new(FeedForwardTrainer::resume(data, config, seed, device, found)?)
        }
        (ModelKind::Gru, None) => Box::new(RecurrentTrainer::new(data, config, seed, device)?),
        (ModelKind::Gru, Some(found)) => {
            Box::new(RecurrentTrainer::resume(data, config, seed, device, found)?)
        }
        (ModelKind::Knn | ModelKind::Torchscript, _) => bail!("such a model is not trained"),
    };
    let device = if device.is_cuda() { "GPU" } else { "processor" };
    Ok((trainer, format!("libtorch on the {device}")))
}

#[cfg(not(feature = "torch"))]
pub(crate) fn trainer(
    _kind: ModelKind,
    _data: &Transitioning<'_>,
    _config: &DynamicsConfig,
    _seed: Seed,
    _device: Device,
    _checkpoint: Option<&Tensors>,
) -> anyhow::Result<(Box<dyn Trainer>, String)> {
    bail!(wanted("such training"))
}

/// What trains agents side by side on a device.
#[cfg(feature = "torch")]
pub(crate) fn accelerator(device: Device) -> anyhow::Result<Box<dyn Accelerator>> {
    Ok(Box::new(calib_torch::Populations::new(calib_torch::device(choice(device))?)))
}

#[cfg(not(feature = "torch"))]
pub(crate) fn accelerator(_device: Device) -> anyhow::Result<Box<dyn Accelerator>> {
    bail!(wanted("--device"))
}

/// Train an encoder on a device, going on from a checkpoint if there is one.
#[cfg(feature = "torch")]
pub(crate) fn represent(
    config: &LaplacianConfig,
    task: Task<'_>,
    checkpoint: &Unfinished,
    device: Device,
    monitor: &dyn Monitor,
) -> anyhow::Result<Trained> {
    let device = calib_torch::device(choice(device))?;
    let mut training = calib_torch::LaplacianTraining::new(config, task, device)?;
    Ok(calib_represent::train_with(&mut training, config, task, Some(checkpoint), monitor)?)
}

#[cfg(not(feature = "torch"))]
pub(crate) fn represent(
    _config: &LaplacianConfig,
    _task: Task<'_>,
    _checkpoint: &Unfinished,
    _device: Device,
    _monitor: &dyn Monitor,
) -> anyhow::Result<Trained> {
    bail!(wanted("such training"))
}

/// A model that was exported from PyTorch, for states of `columns` values; it runs on the processor.
#[cfg(feature = "torch")]
pub(crate) fn open_script(
    path: &std::path::Path,
    columns: usize,
) -> anyhow::Result<Box<dyn Dynamics>> {
    Ok(Box::new(calib_torch::Script::open(path, columns, calib_torch::Device::Cpu)?))
}

#[cfg(not(feature = "torch"))]
pub(crate) fn open_script(
    _path: &std::path::Path,
    _columns: usize,
) -> anyhow::Result<Box<dyn Dynamics>> {
    bail!(wanted("model.kind = \"torchscript\""))
}

#[cfg(feature = "torch")]
fn choice(device: Device) -> calib_torch::DeviceChoice {
    match device {
        Device::Cpu => calib_torch::DeviceChoice::Cpu,
        Device::Cuda => calib_torch::DeviceChoice::Cuda,
        Device::Auto => calib_torch::DeviceChoice::Auto,
    }
}
