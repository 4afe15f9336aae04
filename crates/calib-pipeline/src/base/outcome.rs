//! How a step ended.

use calib_agent::AgentError;
use calib_control::ControlError;
use calib_core::Cancelled;
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
        if error
            .chain()
            .any(|cause| matches!(cause.downcast_ref(), Some(ControlError::Cancelled(_))))
        {
            return "interrupted; agents that act keep nothing: the same command begins anew"
                .to_owned();
        }
        if was_interrupted(error) {
            return "interrupted; run the same command again to go on".to_owned();
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
        cause.is::<Cancelled>()
            || matches!(cause.downcast_ref(), Some(DataError::Cancelled(_)))
            || matches!(cause.downcast_ref(), Some(KnnError::Cancelled(_)))
            || matches!(cause.downcast_ref(), Some(AgentError::Cancelled(_)))
            || matches!(cause.downcast_ref(), Some(SweepError::Cancelled(_)))
            || matches!(cause.downcast_ref(), Some(RepresentError::Cancelled(_)))
            || matches!(cause.downcast_ref(), Some(ModelError::Cancelled(_)))
            || matches!(cause.downcast_ref(), Some(RolloutError::Cancelled(_)))
            || matches!(cause.downcast_ref(), Some(DynamicsError::Cancelled(_)))
            || matches!(cause.downcast_ref(), Some(ControlError::Cancelled(_)))
    })
}
