//! How a step ended.

use calib_agent::AgentError;
use calib_control::ControlError;
use calib_core::Monitor;
use calib_data::DataError;
use calib_dynamics::DynamicsError;
use calib_files::FileError;
use calib_knn::KnnError;
use calib_model::{ModelError, RolloutError};
use calib_represent::RepresentError;
use calib_study::{Place, StudyError};
use calib_sweep::SweepError;

/// How a step ended that did what it should.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Done.
    Done,
    /// Done, but the answer is negative or partial.
    Negative,
    /// A check found what no correct calib writes.
    Faulty,
    /// Parts that others are to make are missing.
    Incomplete,
}

/// Something is missing that another attempt may bring, here or elsewhere; what is there stays.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct Incomplete(pub(crate) String);

/// The user asked to stop.
#[derive(Debug, thiserror::Error)]
#[error("interrupted; run the same command again to go on")]
pub(crate) struct Interrupted;

/// Go on, unless somebody asked to stop.
///
/// # Errors
/// [`Interrupted`].
pub(crate) fn go_on(monitor: &dyn Monitor) -> Result<(), Interrupted> {
    if monitor.interrupted() { Err(Interrupted) } else { Ok(()) }
}

/// Why a step did not do what it should: the study or the data is wrong, the machine refuses, or somebody asked it to stop.
#[derive(Debug, thiserror::Error)]
#[error("{}", Self::told(.0))]
pub struct StepError(anyhow::Error);

impl From<anyhow::Error> for StepError {
    fn from(error: anyhow::Error) -> Self {
        Self(error)
    }
}

impl From<FileError> for StepError {
    fn from(error: FileError) -> Self {
        Self(error.into())
    }
}

impl StepError {
    /// Whether it is no error but the wish of whoever watches: the next run of the same step goes on.
    pub fn was_interrupted(&self) -> bool {
        was_interrupted(&self.0)
    }

    /// Whether something is missing that another attempt may bring.
    pub fn is_incomplete(&self) -> bool {
        self.0.chain().any(<dyn std::error::Error>::is::<Incomplete>)
    }

    /// The chain from the outermost context to the cause. Some errors tell their cause themselves; it is told once.
    pub fn told(error: &anyhow::Error) -> String {
        if was_interrupted(error) {
            return Interrupted.to_string();
        }
        error.chain().map(ToString::to_string).fold(String::new(), |told, cause| {
            if told.is_empty() {
                cause
            } else if told.contains(&cause) {
                told
            } else {
                format!("{told}: {cause}")
            }
        })
    }

    /// Where in the study file the reason is, if it is there.
    pub fn place(&self) -> Option<&Place> {
        self.0.chain().find_map(|cause| cause.downcast_ref::<StudyError>()?.place())
    }
}

/// Whether it is no error but the user's wish.
pub(crate) fn was_interrupted(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        cause.is::<Interrupted>()
            || matches!(cause.downcast_ref(), Some(DataError::Interrupted))
            || matches!(cause.downcast_ref(), Some(KnnError::Interrupted))
            || matches!(cause.downcast_ref(), Some(AgentError::Interrupted))
            || matches!(cause.downcast_ref(), Some(SweepError::Interrupted))
            || matches!(cause.downcast_ref(), Some(RepresentError::Interrupted))
            || matches!(cause.downcast_ref(), Some(ModelError::Interrupted))
            || matches!(cause.downcast_ref(), Some(RolloutError::Interrupted))
            || matches!(cause.downcast_ref(), Some(DynamicsError::Interrupted))
            || matches!(
                cause.downcast_ref(),
                Some(ControlError::Interrupted | ControlError::Knn(KnnError::Interrupted))
            )
    })
}
