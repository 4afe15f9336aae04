use std::{io, path::PathBuf};

use calib_sweep::ProgramStopped;

/// Why a program gave no predictions.
#[derive(Debug, thiserror::Error)]
pub(super) enum ProgramError {
    /// There is no such program, or it cannot be run.
    #[error(
        "`{command}` cannot be started in {}; agent.command is a program and its arguments, such as [\"python3\", \"agent.py\"]",
        folder.display()
    )]
    Start { command: String, folder: PathBuf, source: io::Error },
    /// It is gone, or has closed its output.
    #[error("`{command}` {how} before it had answered {asked}{}", at_last(said))]
    Ended { command: String, how: String, is_killed: bool, asked: String, said: String },
    /// It failed when all was done.
    #[error("`{command}` {how} after its last answer{}", at_last(said))]
    EndedBadly { command: String, how: String, said: String },
    /// It hangs.
    #[error(
        "`{command}` has not answered {asked} for {secs} s; where that may take longer, raise agent.timeout_secs{}",
        at_last(said)
    )]
    Silent { command: String, asked: String, secs: f64, said: String },
    /// It says something else.
    #[error(
        "`{command}` answered {asked} with {line:?}: expected one line such as {expected}; whatever else a program says \
         belongs on its standard error{}",
        at_last(said)
    )]
    Babble { command: String, asked: String, line: String, expected: &'static str, said: String },
    /// It speaks where nothing was asked.
    #[error(
        "`{command}` said {line:?} beside its answers: expected one line for each message, and nothing else on standard output"
    )]
    More { command: String, line: String },
    /// It says what is wrong.
    #[error("`{command}` cannot answer {asked}: {reason}")]
    Refused { command: String, asked: String, reason: String },
    /// Predictions for other states.
    #[error(
        "`{command}` answered {wanted} states with {got} predictions: expected as many, or fewer where the last is null"
    )]
    Count { command: String, got: usize, wanted: usize },
    /// It is another program by now.
    #[error(
        "a file of `{command}` was changed while the sweep ran; what was made before stays, and the same command makes all of it \
         again with the program as it is now"
    )]
    Changed { command: String },
}

/// What a program has said of itself at last.
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
        // What the system kills is no answer: it may be short of memory.
        ProgramError::Ended { is_killed: false, .. }
        | ProgramError::Babble { .. }
        | ProgramError::Refused { .. }
        | ProgramError::Count { .. } => ProgramStopped::CannotAnswer(Box::new(error)),
        _ => ProgramStopped::Failed(Box::new(error)),
    }
}
