use calib_pipeline::{Observer, Outcome, Remark, StepError};
use calib_study::Place;

use crate::output::{excerpt, interrupted, is_to_be_tried_again};

/// How a command ended. The number is the exit code of the process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum ExitStatus {
    /// The command succeeded.
    Done = 0,
    /// The command succeeded, but the answer is negative or partial.
    Negative = 1,
    /// The usage, the study or the data is wrong.
    BadInput = 2,
    /// A bug in calib.
    Internal = 3,
    /// A part of work that is divided among several machines is missing. Existing results stay.
    Incomplete = 4,
    /// TERM, USR1 or USR2 stopped the command (`EX_TEMPFAIL`). The same command
    /// resumes from its saved state, or starts again.
    TryAgain = 75,
    /// The user stopped the command.
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

/// Reports an error, and returns the exit status.
pub(crate) fn report(error: &StepError, observer: &dyn Observer) -> ExitStatus {
    let told = error.to_string();
    let told = if error.was_cancelled() { interrupted() } else { told.as_str() };
    observer.remark(Remark::Error(told));
    match error.exit_code() {
        130 if is_to_be_tried_again() => ExitStatus::TryAgain,
        130 => ExitStatus::Interrupted,
        4 => ExitStatus::Incomplete,
        _ => {
            excerpt(&error.place().map(Place::excerpt).unwrap_or_default());
            ExitStatus::BadInput
        }
    }
}
