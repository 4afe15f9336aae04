use std::fmt;

use calib_core::{RowIndex, Stream};
use calib_files::Fingerprint;
use calib_model::NotFinite;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{FittingRows, SweepError};

/// Where agents are trained.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum EnvironmentId {
    /// A member of the calibration model's ensemble.
    Member(usize),
    /// The held-out log, replayed in time order: the truth that selection is judged by.
    Online,
    /// The training log, replayed: the obvious alternative to a calibration model.
    LogReplay,
}

impl fmt::Display for EnvironmentId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Member(member) => write!(f, "member:{member}"),
            Self::Online => f.write_str("online"),
            Self::LogReplay => f.write_str("log-replay"),
        }
    }
}

/// The stream of a run.
pub struct RunStream {
    /// The states: those of the steps, and what follows so that the last returns are complete. They end where the rollout did.
    pub stream: Box<dyn Stream>,
    /// The row that it starts from.
    pub start_row: RowIndex,
    /// Where the rollout left the finite numbers, if it did. Such a run trains nothing: the error of every value is +∞.
    pub not_finite: Option<NotFinite>,
}

impl RunStream {
    /// A stream of all states that were asked for.
    pub fn complete(stream: impl Stream + 'static, start_row: RowIndex) -> Self {
        Self { stream: Box::new(stream), start_row, not_finite: None }
    }
}

/// A source of streams. The stream of a run depends on the run alone, never on the agent,
/// so that all candidates see the same one.
pub trait Environment: Sync {
    /// Which environment this is.
    fn id(&self) -> EnvironmentId;

    /// Number of runs.
    fn runs(&self) -> usize;

    /// Fingerprint of what the stream of `run` is made from, beside the [`Span`](crate::Span) of the plan.
    fn inputs(&self, run: usize) -> Fingerprint;

    /// Rows of the training log that the simple predictors of `run` may be fitted on.
    fn fitting_rows(&self, run: usize) -> FittingRows {
        let _ = run;
        FittingRows::All
    }

    /// The stream of `run`.
    ///
    /// # Errors
    /// If no stream can be made, such as from a start state that the model lacks.
    fn stream(&self, run: usize) -> Result<RunStream, SweepError>;
}
