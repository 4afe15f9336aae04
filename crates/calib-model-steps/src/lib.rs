//! The steps that make models of a log: representations of its states, calibration models, and rollouts that are
//! compared with the record.
//!
//! Each step has a function `run` that takes a job and a context of `calib-base`, and returns its product.
//! `calib-pipeline` calls the steps for each part of a study.

pub mod model;
mod render;
pub mod represent;
pub mod rollouts;

/// The step patterns by which trajectories are compared: those of the paper's Table 1.
pub const STEP_PATTERNS: [&str; 4] = ["symmetric2", "asymmetric", "symmetricP1", "rabinerJuang:6c"];
