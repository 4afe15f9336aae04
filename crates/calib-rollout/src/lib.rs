//! Start states, rollouts and replay: streams of states for an agent.
//!
//! - [`StartSource`], [`start_states`], [`start_states_of_all`], [`Start`], [`Wanted`]: where rollouts start: random, listed rows, recent rows, a
//!   month of the year, or the nearest recorded states to those of another period.
//! - [`start_rows`]: the same for parametric models, which may start anywhere in their data.
//! - [`rollout`], [`rollouts`], [`Rollout`]: trajectories as lists of recorded rows.
//! - [`JumpStatistics`]: how much a rollout jumps, and how much it merely replays.
//! - [`WalkStatistics`]: how far walks get, and whether they are trapped.
//! - [`RolloutConfig`]: the `[rollout]` section of a study.
//!
//! Every rollout is a pure function of model, member, start and seed.
//!
//! ```
//! use calib_core::{Seed, Segments, Silent, States, Stream as _, Transitions};
//! use calib_knn::{KnnModel, ModelConfig, Weights};
//! use calib_rollout::{JumpStatistics, StartSource, rollout, start_states};
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

mod config;
mod error;
mod month;
mod rollout;
mod start;
mod start_row;
mod statistics;
mod walks;
mod wanted;

pub use config::{Absent, RolloutConfig, StartKind};
pub use error::RolloutError;
pub use month::{month_of, year_of};
pub use rollout::{Rollout, rollout, rollout_seed, rollouts};
pub use start::{Start, StartSource, StartState, start_states, start_states_of_all};
pub use start_row::{StartRow, start_rows};
pub use statistics::JumpStatistics;
pub use walks::WalkStatistics;
pub use wanted::Wanted;
