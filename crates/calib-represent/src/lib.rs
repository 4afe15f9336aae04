//! Laplacian representations of a plant's states: training, scores, selection.

mod config;
mod error;
mod loss;
mod pairs;
mod split;
mod training;

pub use config::{ConfigError, LaplacianConfig, LossConfig, LossForm};
pub use error::RepresentError;
pub use loss::{Loss, LossBuffers, laplacian_loss};
pub use pairs::PairSampler;
pub use split::Split;
pub use training::Training;
