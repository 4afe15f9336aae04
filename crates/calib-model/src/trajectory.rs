use std::sync::Arc;

use calib_core::{RowIndex, States, Stream};
use calib_dynamics::{Ended, PredictedStream, Prediction};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{RequestedStart, Rollout, StartRow};

/// The result of a rollout.
#[derive(Clone, Debug)]
pub enum Trajectory {
    /// Recorded rows.
    Recorded(Rollout),
    /// Predicted states.
    Predicted {
        /// The states.
        prediction: Arc<Prediction>,
        /// The start state.
        start: StartRow,
    },
}

/// The place where a rollout of a model stops being finite.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct NotFinite {
    /// The first step whose state is not finite, counted from 1.
    pub step: usize,
    /// Index of the first column of this state that is not finite.
    pub column: usize,
}

impl Trajectory {
    /// Returns the requested start state, and the distance to its replacement, if there is one.
    pub fn start(&self) -> (RequestedStart, Option<f32>) {
        match self {
            Self::Recorded(rollout) => (rollout.start().wanted, rollout.start().replaced),
            Self::Predicted { start, .. } => (start.wanted, start.replaced),
        }
    }

    /// Returns the recorded row at which it starts.
    pub fn start_row(&self) -> RowIndex {
        match self {
            Self::Recorded(rollout) => rollout.rows()[0],
            Self::Predicted { start, .. } => start.row,
        }
    }

    /// Returns the number of steps, one fewer than states.
    pub fn steps(&self) -> usize {
        match self {
            Self::Recorded(rollout) => rollout.steps(),
            Self::Predicted { prediction, .. } => prediction.steps(),
        }
    }

    /// Returns the visited recorded rows, or `None` if only the start state is recorded.
    pub fn rows(&self) -> Option<&[RowIndex]> {
        match self {
            Self::Recorded(rollout) => Some(rollout.rows()),
            Self::Predicted { .. } => None,
        }
    }

    /// Returns the recorded row after `step` steps. Predictions have a recorded row only at their
    /// start.
    pub fn row(&self, step: usize) -> Option<RowIndex> {
        match self {
            Self::Recorded(rollout) => Some(rollout.rows()[step]),
            Self::Predicted { prediction, .. } => (step == 0).then(|| prediction.start()),
        }
    }

    /// Returns one column of the first `count` states, normalised. `states` are those of the data.
    pub fn values(&self, states: &States, column: usize, count: usize) -> Vec<f32> {
        match self {
            Self::Recorded(rollout) => {
                let rows = rollout.rows()[..count].iter();
                rows.map(|row| states.row(row.get())[column]).collect()
            }
            Self::Predicted { prediction, .. } => prediction.column(column).take(count).collect(),
        }
    }

    /// Returns where its states would have become non-finite, if they would.
    pub fn left_finite(&self) -> Option<NotFinite> {
        match self {
            Self::Recorded(_) => None,
            Self::Predicted { prediction, .. } => match prediction.ended() {
                Ended::Complete => None,
                Ended::NotFinite { step, column } => Some(NotFinite { step, column }),
            },
        }
    }

    /// Returns its states for an agent. `states` are those of the data.
    pub fn stream(&self, states: &States) -> Box<dyn Stream> {
        match self {
            Self::Recorded(rollout) => Box::new(rollout.stream(states)),
            Self::Predicted { prediction, .. } => {
                Box::new(PredictedStream::new(Arc::clone(prediction)))
            }
        }
    }
}
