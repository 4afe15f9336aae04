//! The figures of the paper, drawn from typed rows.

mod figure;
mod learning;
mod recorded;
mod rollout;
mod rollout_grid;
mod sensitivity;

pub use figure::{Figure, Panel};
pub use learning::{LearningCurve, LearningCurves};
pub use recorded::{PeriodUse, RecordedFigure, RecordedLevel, RecordedPeriod};
pub use rollout::{MAX_POINTS, RolloutFigure, Trajectory};
pub use rollout_grid::{RolloutGrid, RolloutRow};
pub use sensitivity::{Dimension, ErrorCurve, ErrorSource, RankCurve, Samples, Sensitivity};
pub(crate) use sensitivity::{Heat, HeatCell, NRMSE};
