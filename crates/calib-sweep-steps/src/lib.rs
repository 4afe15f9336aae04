//! The steps that train agents and judge them: pre-training, sweeps and verdicts. Also supports agents of other
//! programs.
//!
//! Agents are trained in the models of `calib-model-steps`, and reports show its rollouts. `calib-pipeline` calls these
//! steps for each part of a study.

pub mod agents;
pub mod external;
pub mod program;
pub mod render;
pub mod sweep;
pub mod verdict;
