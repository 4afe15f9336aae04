//! Training through libtorch, on CPUs and GPUs.
//!
//! The whole crate needs the feature `libtorch`. Without it the crate is empty, and no part of libtorch is built
//! or linked. Weights have the same file format as those of native training. Models that were trained here are
//! rolled out without libtorch, except `Script`.
//!
//! - `DeviceChoice`, `device`: the device that stores tensors.
//! - `FeedForwardTrainer`, `RecurrentTrainer`: the NN and GRU baselines, as
//!   [`calib_dynamics::Trainer`]s that draw the same mini-batches as native ones.
//! - `LaplacianTraining`: the Laplacian representation.
//! - `Populations`: the agents of many runs, as a [`calib_agent::Accelerator`].
//! - `Script`: a user's dynamics model, exported from PyTorch.
#![cfg(feature = "libtorch")]

mod adam;
mod device;
mod error;
mod feed_forward;
mod laplacian;
mod population;
mod recurrent;
mod script;
mod trainer;

pub use device::{DeviceChoice, device};
pub use error::TorchError;
pub use feed_forward::FeedForwardTrainer;
pub use laplacian::LaplacianTraining;
pub use population::Populations;
pub use recurrent::RecurrentTrainer;
pub use script::Script;
pub use tch::Device;
