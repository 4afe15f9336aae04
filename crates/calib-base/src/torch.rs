//! Work through libtorch, and the errors of a calib without it.
#![cfg_attr(not(feature = "torch"), expect(unused_variables, reason = "libtorch uses them"))]

use calib_agent::Accelerator;
use calib_core::{Monitor, Seed};
use calib_dynamics::{Dynamics, DynamicsConfig, Trainer, Transitioning};
use calib_files::{CheckpointFile, Tensors};
use calib_model::ModelKind;
use calib_represent::{LaplacianConfig, Task, Trained};

use crate::{StepError, options::Device};

/// Checks that this program has libtorch, which `what` needs.
///
/// # Errors
/// [`StepError::Unavailable`] if it does not.
pub fn require(what: &str) -> Result<(), StepError> {
    if cfg!(feature = "torch") { Ok(()) } else { Err(StepError::Unavailable(what.to_owned())) }
}

/// Whether this program cannot make a model of a kind, because it has no libtorch.
pub fn lacks(kind: ModelKind) -> bool {
    kind == ModelKind::Torchscript && !cfg!(feature = "torch")
}

/// Returns a trainer of a network on a device, which resumes from a checkpoint if there is one, and the name of library
/// and device.
///
/// # Errors
/// [`StepError::Unavailable`] without libtorch; or the device does not exist, the checkpoint is of another network, or
/// models of this kind are not trained.
pub fn trainer(
    kind: ModelKind,
    data: &Transitioning<'_>,
    config: &DynamicsConfig,
    seed: Seed,
    device: Device,
    checkpoint: Option<&Tensors>,
) -> Result<(Box<dyn Trainer>, String), StepError> {
    #[cfg(feature = "torch")]
    {
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
            _ => {
                return Err(StepError::message("such a model is not trained"));
            }
        };
        let device = if device.is_cuda() { "GPU" } else { "processor" };
        Ok((trainer, format!("libtorch on the {device}")))
    }
    #[cfg(not(feature = "torch"))]
    {
        Err(StepError::Unavailable("such training".to_owned()))
    }
}

/// Returns the accelerator that trains agents side by side on a device.
///
/// # Errors
/// [`StepError::Unavailable`] without libtorch; or the device does not exist.
pub fn accelerator(device: Device) -> Result<Box<dyn Accelerator>, StepError> {
    #[cfg(feature = "torch")]
    {
        Ok(Box::new(calib_torch::Populations::new(calib_torch::device(choice(device))?)))
    }
    #[cfg(not(feature = "torch"))]
    {
        Err(StepError::Unavailable("--device".to_owned()))
    }
}

/// Trains an encoder on a device, resuming from a checkpoint if there is one.
///
/// # Errors
/// [`StepError::Unavailable`] without libtorch; or the device does not exist, training fails, or the monitor asks to
/// stop.
pub fn represent(
    config: &LaplacianConfig,
    task: Task<'_>,
    checkpoint: &CheckpointFile,
    device: Device,
    monitor: &dyn Monitor,
) -> Result<Trained, StepError> {
    #[cfg(feature = "torch")]
    {
        let device = calib_torch::device(choice(device))?;
        let mut training = calib_torch::LaplacianTraining::new(config, task, device)?;
        Ok(calib_represent::train_with(&mut training, config, task, Some(checkpoint), monitor)?)
    }
    #[cfg(not(feature = "torch"))]
    {
        Err(StepError::Unavailable("such training".to_owned()))
    }
}

/// Opens a model that was exported from PyTorch, for states of `columns` values. It runs on the processor.
///
/// # Errors
/// [`StepError::Unavailable`] without libtorch; or it cannot be read, or is for other states.
pub fn open_script(path: &std::path::Path, columns: usize) -> Result<Box<dyn Dynamics>, StepError> {
    #[cfg(feature = "torch")]
    {
        Ok(Box::new(calib_torch::Script::open(path, columns, calib_torch::Device::Cpu)?))
    }
    #[cfg(not(feature = "torch"))]
    {
        Err(StepError::Unavailable("model.kind = \"torchscript\"".to_owned()))
    }
}

#[cfg(feature = "torch")]
fn choice(device: Device) -> calib_torch::DeviceChoice {
    match device {
        Device::Cpu => calib_torch::DeviceChoice::Cpu,
        Device::Cuda => calib_torch::DeviceChoice::Cuda,
        Device::Auto => calib_torch::DeviceChoice::Auto,
    }
}
