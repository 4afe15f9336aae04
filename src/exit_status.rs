//! How a command ended.

use calib_pipeline::Outcome;

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
