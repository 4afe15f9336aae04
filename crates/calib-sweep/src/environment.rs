use calib_core::{RowIndex, Stream};
use calib_files::Fingerprint;
use calib_model::NotFinite;

use crate::{EnvironmentId, FittingRows, SweepError};

/// The state stream of one training run.
pub struct RunStream {
    /// The states of the steps, then those that complete the last returns. They end where the rollout ended.
    pub stream: Box<dyn Stream>,
    /// The row that the stream starts from.
    pub start_row: RowIndex,
    /// Where the rollout ceased to be finite, if it did. Such a run trains nothing, and the error of every setting is
    /// +∞.
    pub not_finite: Option<NotFinite>,
}

impl RunStream {
    /// Wraps a stream that holds all requested states.
    pub fn complete(stream: impl Stream + 'static, start_row: RowIndex) -> Self {
        Self { stream: Box::new(stream), start_row, not_finite: None }
    }
}

/// A source of streams. The stream of a run depends only on the run, never on the agent, so that all settings see the
/// same stream.
pub trait Environment: Sync {
    /// Returns the identity of the environment.
    fn id(&self) -> EnvironmentId;

    /// Returns the number of runs.
    fn runs(&self) -> usize;

    /// Returns the fingerprint of the inputs of the stream of `run`, without the [`Span`](crate::Span) of the plan.
    fn inputs(&self, run: usize) -> Fingerprint;

    /// Returns the rows of the training log that the simple predictors of `run` may be fitted on.
    fn fitting_rows(&self, run: usize) -> FittingRows {
        let _ = run;
        FittingRows::All
    }

    /// Returns the stream of `run`.
    ///
    /// # Errors
    /// Returns an error if the stream cannot be made, for example from a start state that the model lacks.
    fn stream(&self, run: usize) -> Result<RunStream, SweepError>;
}
