//! The log of a study: simulated, read once, divided.

pub(crate) mod changes;
pub(crate) mod context;
pub(crate) mod partition;
pub(crate) mod plant_of_study;
pub(crate) mod prepared;
pub(crate) mod profile_file;
pub(crate) mod simulate;
