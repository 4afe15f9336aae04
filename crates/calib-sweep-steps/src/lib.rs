//! The steps that train agents and judge them: pre-training, sweeps, verdicts, and the runs of agents that calib does not
//! know.
//!
//! They stand on `calib-model-steps`: agents are trained in its models, and verdicts show its rollouts. `calib-pipeline` calls
//! them for each part of a study.

pub mod agents;
pub mod external;
pub mod program;
pub mod render;
pub mod sweep;
pub mod verdict;
