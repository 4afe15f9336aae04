use std::{io, path::PathBuf};

use calib_sweep::ProgramStopped;

/// The reason why a program gave no predictions.
#[derive(Debug, thiserror::Error)]
pub(super) enum ProgramError {
    /// The program is missing, or cannot be run.
    #[error(
        "`{command}` cannot be started in {}; agent.command is a program and its arguments, such as [\"python3\", \"agent.py\"]",
        folder.display()
    )]
    Start { command: String, folder: PathBuf, source: io::Error },
    /// The program ended, or closed its output.
    #[error("`{command}` {how} before it had answered {asked}{}", at_last(said))]
    Ended { command: String, how: String, is_killed: bool, asked: String, said: String },
    /// The program failed after its last answer.
    #[error("`{command}` {how} after its last answer{}", at_last(said))]
    EndedBadly { command: String, how: String, said: String },
    /// The program did not answer in time.
    #[error(
        "`{command}` has not answered {asked} for {secs} s; where that may take longer, raise agent.timeout_secs{}",
        at_last(said)
    )]
    Silent { command: String, asked: String, secs: f64, said: String },
    /// The answer has another form.
    #[error(
        "`{command}` answered {asked} with {line:?}: expected one line such as {expected}; whatever else a program says \
         belongs on its standard error{}",
        at_last(said)
    )]
    Babble { command: String, asked: String, line: String, expected: &'static str, said: String },
    /// The program wrote a line without being asked.
    #[error(
        "`{command}` said {line:?} beside its answers: expected one line for each message, and nothing else on standard output"
    )]
    More { command: String, line: String },
    /// The program reported an error.
    #[error("`{command}` cannot answer {asked}: {reason}")]
    Refused { command: String, asked: String, reason: String },
    /// The number of predictions is wrong.
    #[error(
        "`{command}` answered {wanted} states with {got} predictions: expected as many, or fewer where the last is null"
    )]
    Count { command: String, got: usize, wanted: usize },
    /// The files of the program changed during the sweep.
    #[error(
        "a file of `{command}` was changed while the sweep ran; what was made before stays, and the same command makes all of it \
         again with the program as it is now"
    )]
    Changed { command: String },
}

/// Formats the last error output of a program.
fn at_last(text: &str) -> String {
    match text.trim() {
        "" => String::new(),
        text => {
            let lines: Vec<&str> =
                text.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
            format!("; at last it said: {}", lines.join(" | "))
        }
    }
}

pub(super) fn failed(error: ProgramError) -> ProgramStopped {
    match error {
        // A process that the system killed has not answered. The machine may be short of memory.
        ProgramError::Ended { is_killed: false, .. }
        | ProgramError::Babble { .. }
        | ProgramError::Refused { .. }
        | ProgramError::Count { .. } => ProgramStopped::CannotAnswer(Box::new(error)),
        _ => ProgramStopped::Failed(Box::new(error)),
    }
}
