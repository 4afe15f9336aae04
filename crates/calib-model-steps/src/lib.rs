//! The steps that make models of a log: representations of its states, calibration models, and rollouts beside what was
//! recorded.
//!
//! Each has a function `run` that takes a job and a context of `calib-base`, and returns what it made or found. `calib-pipeline` calls
//! them for each part of a study.

pub mod model;
mod render;
pub mod represent;
pub mod rollouts;

/// The step patterns by which trajectories are compared: those of the paper's Table 1.
pub const STEP_PATTERNS: [&str; 4] = ["symmetric2", "asymmetric", "symmetricP1", "rabinerJuang:6c"];
