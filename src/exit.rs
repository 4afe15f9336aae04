use calib_agent::AgentError;
use calib_data::DataError;
use calib_dynamics::DynamicsError;
use calib_knn::KnnError;
use calib_represent::RepresentError;
use calib_rollout::RolloutError;
use calib_study::{Place, StudyError};
use calib_sweep::SweepError;

use crate::output::Printer;

/// How a command ended; the number is the process's exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum ExitStatus {
    /// Done.
    Done = 0,
    /// Done, but the answer is negative or partial.
    Negative = 1,
    /// The usage, the study or the data is wrong.
    BadInput = 2,
    /// A bug in calib.
    Internal = 3,
    /// The user stopped it.
    Interrupted = 130,
}

/// The user asked to stop.
#[derive(Debug, thiserror::Error)]
#[error("interrupted; run the same command again to go on")]
pub(crate) struct Interrupted;

/// Say what went wrong, and with which status to exit.
pub(crate) fn report(error: &anyhow::Error, printer: &Printer) -> ExitStatus {
    if was_interrupted(error) {
        printer.error(&Interrupted.to_string());
        return ExitStatus::Interrupted;
    }
    let place = error.chain().find_map(|cause| cause.downcast_ref::<StudyError>()?.place());
    printer.error_in(&message(error), &place.map(Place::excerpt).unwrap_or_default());
    ExitStatus::BadInput
}

/// The chain from the outermost context to the cause. Some errors tell their cause themselves; it is told once.
fn message(error: &anyhow::Error) -> String {
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

/// Whether it is no error but the user's wish.
pub(crate) fn was_interrupted(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        cause.is::<Interrupted>()
            || matches!(cause.downcast_ref(), Some(DataError::Interrupted))
            || matches!(cause.downcast_ref(), Some(KnnError::Interrupted))
            || matches!(cause.downcast_ref(), Some(AgentError::Interrupted))
            || matches!(cause.downcast_ref(), Some(SweepError::Interrupted))
            || matches!(cause.downcast_ref(), Some(RepresentError::Interrupted))
            || matches!(cause.downcast_ref(), Some(RolloutError::Interrupted))
            || matches!(cause.downcast_ref(), Some(DynamicsError::Interrupted))
    })
}
