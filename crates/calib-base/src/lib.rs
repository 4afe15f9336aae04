//! The foundation of every step from a log to a verdict.
//!
//! A step takes the [`Job`](calib_study::Job) of a study and a [`RunContext`](log::context::RunContext). The context
//! holds the observer that a step reports to ([`output`]), and the logs that were opened ([`log`]). A step writes an
//! [`Artefact`](artefact::Artefact), returns a [`StepResult`](outcome::StepResult), and fails with a [`StepError`].
//!
//! Steps are in `calib-model-steps`, `calib-sweep-steps` and `calib-pipeline`. Callers use `calib-pipeline`, which
//! re-exports the types of this crate that steps take and return.

pub mod artefact;
pub mod clock;
pub mod cost;
pub mod disk_room;
mod error;
pub mod frames;
pub mod left_alone;
pub mod log;
pub mod memory;
pub mod options;
pub mod outcome;
pub mod output;
pub mod progress;
pub mod resolved;
pub mod stale;
pub mod torch;

pub use error::{Context, StepError};
