//! Rollouts, and how far they are from what was recorded.

pub(crate) mod collapse;
pub(crate) mod comparison;
pub(crate) mod figures;
pub(crate) mod one_step;
pub(crate) mod rollout;
pub(crate) mod trajectory_columns;
pub(crate) mod truth;
