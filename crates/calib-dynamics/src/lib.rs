//! Parametric dynamics models: networks that predict the next state, with their training and their rollouts.
//!
//! They are the baselines of the paper: a feed-forward network (NN) and a recurrent one (GRU). They are trained on one-step prediction, and
//! rolled out by feeding predictions back. Unlike a nearest-neighbour model, they can leave the data.
//!
//! - [`DynamicsConfig`]: the `[dynamics]` section of a study.
//! - [`Dynamics`], [`LaneRollouts`]: any such model: state in, next state out, perhaps with a hidden state. [`FeedForward`] and
//!   [`Recurrent`] are in this crate. Other crates may add more.
//! - [`Transitioning`]: the transitions for training and for validation, split in time.
//! - [`Trainer`], [`FeedForwardTrainer`], [`RecurrentTrainer`], [`TrainingRecord`], [`TrainingState`]: training by epochs. It can be
//!   interrupted and resumed, with the same bytes as the result.
//! - [`predict`], [`Rollouts`], [`Prediction`], [`Ended`]: rollouts in lockstep, with one matrix product for many.
//! - [`Residuals`], [`Noise`], [`ResidualNoise`]: the prediction errors of a network, which rollouts can add as noise.
//!
//! ```
//! use calib_core::{RowIndex, Seed, Segments, Silent, States, Transitions};
//! use calib_dynamics::{DynamicsConfig, FeedForwardTrainer, Trainer as _, Transitioning, predict};
//!
//! let values = (0..400_u16).map(|row| (f32::from(row) * 0.2).sin()).collect();
//! let states = States::new(values, 400, 1).unwrap();
//! let transitions = Transitions::new(Segments::from_lengths([400]).unwrap());
//! let config = DynamicsConfig { hidden_units: 16, epochs: 3, ..DynamicsConfig::default() };
//! let data = Transitioning::new(&states, &transitions, config.validation_fraction).unwrap();
//! let mut trainer = FeedForwardTrainer::new(&data, &config, Seed::new(7));
//! while !trainer.record().is_complete(&config) {
//!     trainer.epoch(&Silent).unwrap();
//! }
//! let model = trainer.model();
//! let rollouts = predict(&model, &states, transitions.segments(), &[RowIndex(10)], 50, &Silent).unwrap();
//! assert_eq!(rollouts[0].steps(), 50);
//! ```

mod activation;
mod config;
mod data;
mod error;
mod feed_forward;
mod gates;
mod model;
mod noise;
mod predict;
mod record;
mod recurrent;
mod recurrent_pass;
mod recurrent_train;
mod state;
mod train;
mod weights;

pub use config::{DynamicsConfig, Keep};
pub use data::{Transitioning, sequences};
pub use error::DynamicsError;
pub use feed_forward::FeedForward;
pub use model::{Dynamics, LANES, LaneRollouts};
pub use noise::{NOISE_VERSION, Noise, ResidualNoise, Residuals, Rollouts};
pub use predict::{Ended, PredictedStream, Prediction, Start, predict};
pub use record::{EpochLoss, Trainer, TrainingRecord, seed_of_parameters};
pub use recurrent::{GruLayer, Recurrent};
pub use recurrent_train::{RecurrentTrainer, recurrent_training_bytes};
pub use state::{TrainingState, pass};
pub use train::{FeedForwardTrainer, Learnable, NativeTrainer};
