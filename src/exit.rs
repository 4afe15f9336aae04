use calib_data::DataError;
use calib_pipeline::{Observer, Outcome, Remark, StepError};
use calib_study::{Place, StudyError};

use crate::output::{excerpt, is_to_be_tried_again};

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
    /// A part of work that is spread over several machines is missing; what there is stays.
    Incomplete = 4,
    /// TERM, USR1 or USR2 stopped it: the state is kept, and the same command goes on from it (`EX_TEMPFAIL`).
    TryAgain = 75,
    /// The user stopped it.
    Interrupted = 130,
}

impl From<Outcome> for ExitStatus {
    fn from(outcome: Outcome) -> Self {
        match outcome {
            Outcome::Done => Self::Done,
            Outcome::Negative => Self::Negative,
            Outcome::Faulty => Self::Internal,
            Outcome::Incomplete => Self::Incomplete,
        }
    }
}

/// Say what went wrong, and with which status to exit.
pub(crate) fn report(error: &anyhow::Error, observer: &dyn Observer) -> ExitStatus {
    let told = StepError::told(error);
    observer.remark(Remark::Error(&told));
    if was_interrupted(error) {
        return if is_to_be_tried_again() { ExitStatus::TryAgain } else { ExitStatus::Interrupted };
    }
    if is_incomplete(error) {
        return ExitStatus::Incomplete;
    }
    excerpt(&place(error).map(Place::excerpt).unwrap_or_default());
    ExitStatus::BadInput
}

fn was_interrupted(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        cause.downcast_ref().is_some_and(StepError::was_interrupted)
            || matches!(cause.downcast_ref(), Some(DataError::Cancelled(_)))
    })
}

fn is_incomplete(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| cause.downcast_ref().is_some_and(StepError::is_incomplete))
}

/// Where in the study file the reason is, if it is there.
fn place(error: &anyhow::Error) -> Option<&Place> {
    error.chain().find_map(|cause| {
        let of_step = || cause.downcast_ref::<StepError>()?.place();
        of_step().or_else(|| cause.downcast_ref::<StudyError>()?.place())
    })
}
