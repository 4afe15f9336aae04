//! A rollout of either sort, seen alike.

use calib_core::{RowIndex, States};
use calib_dynamics::{Ended, Prediction};
use calib_rollout::{Rollout, StartRow, Wanted};

/// What a model was rolled out to.
pub(crate) enum Trajectory {
    /// Recorded rows.
    Recorded(Rollout),
    /// Predicted states.
    Predicted {
        /// The states.
        prediction: Prediction,
        /// Where it starts.
        start: StartRow,
    },
}

impl Trajectory {
    /// What it was to start from, and how far from that it starts, if another state stands for it.
    pub(crate) fn start(&self) -> (Wanted, Option<f32>) {
        match self {
            Self::Recorded(rollout) => (rollout.start().wanted, rollout.start().replaced),
            Self::Predicted { start, .. } => (start.wanted, start.replaced),
        }
    }

    /// Steps taken; one fewer than states.
    pub(crate) fn steps(&self) -> usize {
        match self {
            Self::Recorded(rollout) => rollout.steps(),
            Self::Predicted { prediction, .. } => prediction.steps(),
        }
    }

    /// The recorded row after `step` steps. Predictions are none, but for their start.
    pub(crate) fn row(&self, step: usize) -> Option<RowIndex> {
        match self {
            Self::Recorded(rollout) => Some(rollout.rows()[step]),
            Self::Predicted { prediction, .. } => (step == 0).then(|| prediction.start()),
        }
    }

    /// One column of the first `count` states, normalised; `states` are those of the data.
    pub(crate) fn values(&self, states: &States, column: usize, count: usize) -> Vec<f32> {
        match self {
            Self::Recorded(rollout) => {
                let rows = rollout.rows()[..count].iter();
                rows.map(|row| states.row(row.get())[column]).collect()
            }
            Self::Predicted { prediction, .. } => prediction.column(column).take(count).collect(),
        }
    }

    /// The step that is not there because its state would not have been finite.
    pub(crate) fn not_finite(&self) -> Option<(usize, usize)> {
        match self {
            Self::Predicted { prediction, .. } => match prediction.ended() {
                Ended::Complete => None,
                Ended::NotFinite { step, column } => Some((step, column)),
            },
            Self::Recorded(_) => None,
        }
    }
}
