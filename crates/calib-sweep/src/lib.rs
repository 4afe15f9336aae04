//! Hyperparameter sweeps: plan → units → store → verdict.
//!
//! - [`SweepConfig`]: the `[sweep]` section of a study. [`candidates`] expands its grid of lists and ranges into all
//!   combinations, or into a random or Sobol sample of them.
//! - [`Environment`]: where agents are trained. [`MemberEnvironment`] rolls out one ensemble member of a calibration
//!   model of any kind. [`ReplayEnvironment`] replays the held-out log (Online) or the training log.
//! - [`Plan`]: every [`Unit`] of work (environment, sensor, run). One unit trains **all** settings on one stream with
//!   the same mini-batches, so they differ only by their values. Units of several sensors share one pass over a run's
//!   stream. Agents may [`Start`] from checkpoints.
//! - [`Baselines`]: simple predictors that agents start from. [`simple_scores`] returns their errors without an agent.
//! - [`Plan::race`]: drops the worse settings, which make no more runs.
//! - [`Plan::with_accelerator`]: trains all runs side by side on an accelerator.
//! - [`Program`]: agents of an external program, which replace calib's own.
//! - [`UnitStore`]: one small file per unit, with each setting's run under its own key. [`Plan::run`] makes only the
//!   missing runs. A new value in the grid does not affect the runs of the other settings.
//! - [`verdict`]: the choice of a [`Rule`], its stability, and its error on held-out [`Windows`] next to that of each
//!   [`ChoiceBaseline`].
//!
//! ```
//! use calib_agent::AgentConfig;
//! use calib_core::Seed;
//! use calib_sweep::{SweepConfig, candidates};
//!
//! let mut sweep = SweepConfig::default();
//! sweep.grid.clear();
//! sweep.grid.insert("learning_rate".to_owned(), vec![1e-4.into(), 1e-2.into()].into());
//! // The value of [agent] itself is always among them.
//! let all = candidates(&sweep, &AgentConfig::default(), Seed::new(1))?;
//! assert_eq!(all.iter().filter(|candidate| candidate.is_default).count(), 1);
//! assert_eq!(all[0].label(), "learning_rate = 1e-4");
//! # Ok::<(), calib_sweep::SweepError>(())
//! ```

mod axis;
mod baselines;
mod candidate;
mod closed_environment;
mod cohorts;
mod config;
mod environment;
mod environment_id;
mod error;
mod error_scale;
mod fitting_rows;
mod grid_end;
mod member;
mod pass;
mod plan;
mod points;
mod program;
mod race;
mod range;
mod replay;
mod run_checkpoint;
mod sampling;
mod sink;
mod sobol;
mod span;
mod start;
mod store;
mod unit;
mod verdict;
mod windows;
mod written;

pub use axis::{Axis, AxisError};
pub use baselines::{
    Baselines, FittedSimple, RecordedWindow, SimpleScore, recorded_windows, simple_scores,
};
pub use calib_agent::CurvePoint;
pub use calib_model::NotFinite;
pub use candidate::{Candidate, candidates};
pub use closed_environment::ClosedEnvironment;
pub use config::{RaceKind, SweepConfig};
pub use environment::{Environment, RunStream};
pub use environment_id::EnvironmentId;
pub use error::SweepError;
pub use error_scale::ErrorScale;
pub use fitting_rows::FittingRows;
pub use grid_end::GridEnd;
pub use member::{MemberEnvironment, RolloutOptions};
pub use plan::{
    CompletedSweep, PassId, Plan, PlanOptions, PlannedSensor, RESULT_VERSION, ReadyPass,
    SensorGroup, StoredUnits,
};
pub use points::Scale;
pub use program::{PredictionRequest, Program, ProgramPredictions, ProgramStopped};
pub use race::raced;
pub use range::Range;
pub use replay::ReplayEnvironment;
pub use run_checkpoint::WORK_BETWEEN;
pub use sampling::Sampling;
pub use sink::UnitSink;
pub use span::Span;
pub use start::Start;
pub use store::{UnitStore, remove_states};
pub use unit::{PlannedUnit, RunRow, SettingRun, Unit, UnitResult, UnitRuns};
pub use verdict::{
    Agreement, BaselineRegret, ChoiceBaseline, Dropped, ENOUGH_WINDOWS, EnvironmentScores, Grade,
    Judging, PartChoice, Recommendation, Rule, RuleChoice, SensorVerdict, Share, SimpleComparison,
    Truth, WindowTruth, verdict,
};
pub use windows::{ScoringDemand, Windows};
pub use written::written;
