//! TD(0) nexting agents: linear and MLP value functions, replay buffer, returns, scores.
//!
//! An agent predicts the discounted sum of one sensor's future, `G_t = Σ_k γᵏ o_{t+k+1}`, from the state `s_t`, and
//! learns v by semi-gradient TD(0) (Sutton & Barto 2018):
//!
//! `δ = o_{t+1} + γ v(s_{t+1}) − v(s_t)`; θ moves along the mean over a mini-batch of `δ ∇v(s_t)`.
//!
//! The parts, in the order of a run:
//!
//! - [`AgentConfig`]: every hyperparameter, checked.
//! - [`train`]: trains a population of agents over one [`Stream`](calib_core::Stream). Each agent's result is to the
//!   byte that of training it alone.
//! - [`train_learners`]: trains agents that predict several sensors, start from a [`Checkpoint`], or run so long that a
//!   [`Checkpointer`] stores their state.
//! - [`train_together`]: trains many runs side by side, with their networks on an [`Accelerator`].
//! - [`pretrain`]: makes epochs over recorded transitions before such a run, with validation and early stopping.
//! - [`StateFile`]: the state of unfinished training in a file.
//! - [`Part`], [`CurveRule`]: the steps over which errors are averaged, and how the learning curve is sub-sampled.
//! - [`score_predictions`]: the same scores for predictions that an external agent made.
//! - [`SimplePredictor`], [`Fitter`]: predictors without a step size, fitted on a log. An agent has to beat them.
//! - [`RunOutcome`]: errors and the learning curve.
//! - [`training_bytes`], [`pretraining_bytes`]: the memory that training takes.
//! - [`discounted_returns`], [`truncation_horizon`], [`ReturnMoments`]: the Monte-Carlo returns against which
//!   predictions are scored.
//!
//! ```
//! use calib_agent::{AgentConfig, CurveRule, Part, ValueFunction, train};
//! use calib_core::{RowIndex, RowStream, Seed, Silent, States};
//!
//! // A sensor that alternates between 0 and 1, seen by agents of two step sizes that discount by one half.
//! let states = States::new(vec![0.0, 1.0], 2, 1)?;
//! let stream = RowStream::unbroken(states, (0..4_000).map(|t| RowIndex::new(t % 2)).collect());
//! let agents = [1e-4, 1e-2].map(|learning_rate| AgentConfig {
//!     value_function: ValueFunction::Linear,
//!     gamma: 0.5,
//!     batch_size: 32,
//!     learning_rate,
//!     ..AgentConfig::default()
//! });
//! let outcomes = train(&stream, 0, &agents, CurveRule::default(), Seed::new(1), &Silent)?;
//! let scores = outcomes.iter().map(|outcome| outcome.scores.of(Part::FinalQuarter).unwrap());
//! let settled: Vec<f64> = scores.map(|score| score.rmse).collect();
//! assert!(settled[1] < settled[0]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod accelerator;
mod checkpointer;
mod config;
mod curve;
mod error;
#[cfg(test)]
mod golden;
mod horizon;
mod kernels;
mod learner;
mod linear;
mod lockstep;
mod memory;
mod mlp;
mod network;
mod online;
mod outcome;
mod population;
mod predictions;
mod pretrain;
mod replay;
mod returns;
mod scoring;
mod simple;
mod state_file;
mod traces;
mod train;
mod validation;
mod values;

pub use accelerator::{Accelerator, Lockstep, LockstepResults, Networks, Steps};
pub use checkpointer::{Checkpointer, NoKeeper, RunProgress, RunState, ValueState};
pub use config::{
    AgentConfig, AgentConfigError, AgentKind, OptimiserKind, Precision, ReplayKind, ValueFunction,
};
pub use curve::{CurvePoint, CurveRule};
pub use error::AgentError;
pub use horizon::truncation_horizon;
pub use learner::{Checkpoint, Learner, layer_sizes, parameter_count};
pub use lockstep::{MOST_TOGETHER, check_accelerated, runs_together, train_together};
pub use memory::{pretraining_bytes, training_bytes};
pub use outcome::RunOutcome;
pub use predictions::score_predictions;
pub use pretrain::{PretrainSettings, Pretrained, Pretraining, PretrainingDiverged, pretrain};
pub use returns::{ReturnMoments, discounted_returns};
pub use scoring::{Part, PartScore, Scores};
pub use simple::{FittedPredictor, Fitter, Mixture, SimplePredictor};
pub use state_file::StateFile;
pub use traces::with_traces;
pub use train::{Run, train, train_learners};
pub use validation::Epoch;
