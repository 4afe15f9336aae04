//! The log of a study: simulated, read once, divided.

pub(crate) mod changes;
pub mod context;
pub mod partition;
pub mod plant_of_study;
pub mod prepared;
pub mod profile_file;
pub mod simulate;
pub mod sources;
pub mod stand_in;
