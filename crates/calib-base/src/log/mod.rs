//! The log of a study: simulated, prepared once, and divided.

pub(crate) mod changes;
pub mod context;
pub mod partition;
pub mod plant_of_study;
pub mod prepared;
pub mod prepared_log;
pub mod profile_file;
pub mod simulate;
pub mod sources;
pub mod stand_in;
