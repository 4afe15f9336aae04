//! Calibration models: their start states, their rollouts, and statistics of these.
//!
//! - [`CalibrationModel`]: the interface of every kind of model. [`NeighborModel`] recombines recorded transitions,
//!   [`NetworkModel`] predicts. [`Trajectory`]: the result of a rollout from a [`ModelStart`].
//! - [`ModelKind`], [`ModelFamily`]: the kinds of models and their families.
//! - [`StartSource`], [`start_states`], [`start_states_of_all`], [`Start`], [`RequestedStart`]: where rollouts start:
//!   random, listed rows, recent rows, a month of the year, or the nearest recorded states to those of another period.
//! - [`start_rows`]: the same for parametric models, which may start anywhere in their data.
//! - [`rollout`], [`rollouts`], [`Rollout`]: trajectories as lists of recorded rows.
//! - [`JumpStatistics`]: how often a rollout jumps, and how much it merely replays.
//! - [`RolloutStatistics`]: how far rollouts get, and whether they are trapped.
//! - [`RolloutConfig`]: the `[rollout]` section of a study.
//!
//! Every rollout is a pure function of model, member, start and seed.
//!
//! ```
//! use calib_core::{Seed, Segments, Silent, States, Stream as _, Transitions};
//! use calib_knn::{KnnModel, ModelConfig, Weights};
//! use calib_model::{JumpStatistics, StartSource, rollout, start_states};
//!
//! let values = (0..200_u16).map(|row| (f32::from(row) * 0.3).sin()).collect();
//! let states = States::new(values, 200, 1).unwrap();
//! let transitions = Transitions::new(Segments::from_lengths([200]).unwrap());
//! let model = KnnModel::build(states, transitions, &ModelConfig::default(), &Silent).unwrap();
//!
//! let member = model.member(2);
//! let seed = Seed::new(7);
//! let starts = start_states(&member, StartSource::Random, 1, seed).unwrap();
//! let trajectory = rollout(&member, &starts[0], 1000, Weights::Linear, seed);
//! assert_eq!(trajectory.stream(model.states()).len(), 1001);
//! assert!(JumpStatistics::of([trajectory.rows()]).jump_rate > 0.1);
//! ```

mod calibration_model;
mod config;
mod error;
mod kind;
mod model_start;
mod month;
mod neighbors;
mod network;
mod requested_start;
mod rollout;
mod rollout_statistics;
mod start;
mod start_row;
mod start_source;
mod statistics;
mod trajectory;

pub use calib_knn::Weights;
pub use calibration_model::{CalibrationModel, Rolling, Search, Unseen};
pub use config::{Absent, RolloutConfig, StartKind};
pub use error::{ModelError, RolloutError};
pub use kind::{ModelFamily, ModelKind};
pub use model_start::ModelStart;
pub use month::{month_of, year_of};
pub use neighbors::NeighborModel;
pub use network::NetworkModel;
pub use requested_start::RequestedStart;
pub use rollout::{Rollout, rollout, rollout_seed, rollouts};
pub use rollout_statistics::RolloutStatistics;
pub use start::{Start, StartState, start_states, start_states_of_all};
pub use start_row::{StartRow, start_rows};
pub use start_source::StartSource;
pub use statistics::JumpStatistics;
pub use trajectory::{NotFinite, Trajectory};
