//! Rollouts, and how far they are from what was recorded.

pub mod collapse;
pub mod comparison;
pub mod figures;
pub mod one_step;
pub mod rollout;
pub mod trajectory_columns;
pub(crate) mod truth;
