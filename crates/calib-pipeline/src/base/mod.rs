//! What every step stands on: manifests and claims, what is stale, options and outcomes, time and memory.

pub(crate) mod artefact;
pub(crate) mod clock;
pub(crate) mod error;
pub(crate) mod frames;
pub(crate) mod left_alone;
pub(crate) mod memory;
pub(crate) mod options;
pub(crate) mod outcome;
pub(crate) mod resolved;
pub(crate) mod stale;
pub(crate) mod torch;
