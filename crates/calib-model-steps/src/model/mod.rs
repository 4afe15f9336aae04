//! Calibration models: neighbours and networks, built, stored, opened and rolled out
//! through one interface.

pub(crate) mod build_check;
pub(crate) mod build_cost;
pub mod build_model;
pub(crate) mod build_network;
pub mod build_plan;
pub mod built_model;
pub mod calibration;
pub mod jumps;
pub mod kinds;
pub mod model_files;
pub mod recurrence;
pub mod starts;
pub(crate) mod train_model;
