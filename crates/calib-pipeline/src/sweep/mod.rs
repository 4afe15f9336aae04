//! Sweeps: what agents are trained in, and what is left to run.

pub(crate) mod cost;
pub(crate) mod environments;
pub(crate) mod expected;
mod manifest;
pub(crate) mod notes;
pub(crate) mod plan;
pub(crate) mod planned;
pub(crate) mod recorded;
mod run;
pub(crate) mod setting;
pub(crate) mod simple;
pub(crate) mod standing_still;
pub(crate) mod streams;
pub(crate) mod tables;

pub(crate) use manifest::{LearnedStates, SweepFacts, SweepManifest};
pub(crate) use run::{Found, Pool, Source, on_device, put_together, run, unit_store, wall_secs};
pub use run::{SweepResult, Swept};
