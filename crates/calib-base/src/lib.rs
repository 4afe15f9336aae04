//! What every step from a log to a verdict stands on.
//!
//! A step takes the [`Job`](calib_study::Job) of a study and a [`RunContext`](log::context::RunContext): whom it tells what it does
//! ([`output`]), and the logs that were opened ([`log`]). What it leaves behind is an [`Artefact`](artefact::Artefact), what it came to a
//! [`StepResult`](outcome::StepResult), and what went wrong a [`StepError`].
//!
//! Steps are in `calib-model-steps`, `calib-sweep-steps` and `calib-pipeline`. Whoever calls them uses `calib-pipeline`, which has
//! again what of this crate they take and return.

pub mod artefact;
pub mod clock;
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
