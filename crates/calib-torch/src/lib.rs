//! Training through libtorch, on processors and GPUs.
//!
//! Everything here wants the feature `libtorch`; without it the crate is empty, and nothing of libtorch is built
//! or linked. Weights are the same files as those of native training, and models that were trained here are rolled
//! out without libtorch, but for `Script`.
//!
//! - `DeviceChoice`, `device`: where tensors live.
//! - `FeedForwardTrainer`, `RecurrentTrainer`: the NN and GRU baselines, as
//!   [`calib_dynamics::Trainer`]s that draw the same mini-batches as native ones.
//! - `LaplacianTraining`: the Laplacian representation.
//! - `Populations`: the agents of many runs, as a [`calib_agent::Accelerator`].
//! - `Script`: a dynamics model of the user's, exported from PyTorch.
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
