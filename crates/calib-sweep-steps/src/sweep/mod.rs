//! Sweeps: their environments, plans and results.

pub mod agent_seed;
mod before_model;
pub mod candidates;
pub(crate) mod constant_sensors;
pub mod cost;
pub mod environments;
pub mod expected;
pub mod groups;
mod manifest;
pub mod memory;
pub(crate) mod notes;
pub mod plan;
pub mod planned;
pub(crate) mod recorded;
mod run;
pub mod setting;
pub mod simple;
pub mod streams;
pub(crate) mod tables;
mod unit_store;

pub use before_model::before_model;
pub use manifest::SweepManifest;
pub(crate) use manifest::{LearnedStates, SweepFacts};
pub use run::{
    KnownUnits, ResultSource, SharedRuns, SweepResult, Swept, on_device, put_together, run,
    wall_secs,
};
pub use unit_store::unit_store;
