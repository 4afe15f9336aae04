//! Calibration models: neighbours and networks, built, kept, opened, rolled out alike.

pub(crate) mod build_check;
pub(crate) mod build_model;
pub(crate) mod build_network;
pub(crate) mod build_plan;
pub(crate) mod calibration;
pub(crate) mod jumps;
pub(crate) mod kinds;
pub(crate) mod model_files;
pub(crate) mod recurrence;
pub(crate) mod starts;
pub(crate) mod train_model;
