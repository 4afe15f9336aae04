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
mod manifest;
mod member_recurrence;
pub mod model_files;
pub mod recurrence;
pub mod starts;
pub(crate) mod train_model;
mod training_summary;
