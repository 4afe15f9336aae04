use calib_data::DataError;
use calib_pipeline::{Observer, Outcome, Remark, StepError};
use calib_study::{Place, StudyError};

use crate::output::excerpt;

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

impl From<Outcome> for ExitStatus {
    fn from(outcome: Outcome) -> Self {
        match outcome {
            Outcome::Done => Self::Done,
            Outcome::Negative => Self::Negative,
            Outcome::Faulty => Self::Internal,
        }
    }
}

/// Say what went wrong, and with which status to exit.
pub(crate) fn report(error: &anyhow::Error, observer: &dyn Observer) -> ExitStatus {
    let told = StepError::told(error);
    observer.remark(Remark::Error(&told));
    if was_interrupted(error) {
        return ExitStatus::Interrupted;
    }
    excerpt(&place(error).map(Place::excerpt).unwrap_or_default());
    ExitStatus::BadInput
}

fn was_interrupted(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        cause.downcast_ref().is_some_and(StepError::was_interrupted)
            || matches!(cause.downcast_ref(), Some(DataError::Interrupted))
    })
}

/// Where in the study file the reason is, if it is there.
fn place(error: &anyhow::Error) -> Option<&Place> {
    error.chain().find_map(|cause| {
        let of_step = || cause.downcast_ref::<StepError>()?.place();
        of_step().or_else(|| cause.downcast_ref::<StudyError>()?.place())
    })
}
