//! The paper's figures, from typed rows.

mod figure;
mod rollout;
mod sensitivity;

pub use figure::Figure;
pub use rollout::{MAX_POINTS, RolloutFigure, Trajectory};
pub use sensitivity::{ErrorCurve, ErrorSource, RankCurve, Score, Sensitivity};
