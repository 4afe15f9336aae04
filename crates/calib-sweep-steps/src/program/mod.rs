//! Agents of an external program. calib starts the program, and they exchange lines of JSON. The guide for its author
//! is `docs/guides/external-agents.md`. This module has agents that predict. Those that act are in `calib-pipeline`,
//! and use the same [`Process`].

mod command;
mod error;
#[cfg(target_os = "linux")]
mod guard;
mod message;
mod process;

use std::{fmt, ops::Range};

use calib_agent::AgentConfig;
use calib_base::StepError;
use calib_core::Monitor;
use calib_files::Fingerprint;
use calib_study::Job;
use calib_sweep::{PredictionRequest, Program, ProgramPredictions, ProgramStopped};

pub use command::ProgramCommand;
use error::{ProgramError, failed};
pub use message::{Answer, PROTOCOL_VERSION, Ready, line};
use message::{Begin, Predictions, begin, states};
pub use process::Process;

/// Largest number of bytes of a prediction in an answer.
const PREDICTION_BYTES: usize = 64;

/// Agents of a program that predict.
#[derive(Debug)]
pub(crate) struct ExternalAgents {
    program: ProgramCommand,
    states_per_message: usize,
}

impl ExternalAgents {
    /// Returns the agents of a study, if they belong to a program.
    ///
    /// # Errors
    /// Returns an error if a file that the command names cannot be read.
    pub(crate) fn of(job: &Job) -> Result<Option<Self>, StepError> {
        let program = ProgramCommand::of_study(job)?;
        let states_per_message = job.study().agent.states_per_message;
        Ok(program.map(|program| Self { program, states_per_message }))
    }

    /// Returns the predictions of one agent.
    fn predicted(
        &self,
        process: &mut Process<'_>,
        wanted: &PredictionRequest<'_>,
        agent: &AgentConfig,
        monitor: &dyn Monitor,
    ) -> Result<ProgramPredictions, ProgramStopped> {
        let told = Begin {
            sensor: wanted.sensor,
            column: wanted.column,
            columns: wanted.stream.width(),
            gamma: agent.gamma,
            seed: wanted.seed.get(),
            steps: wanted.steps,
            parameters: &agent.parameters,
        };
        let what = LastRequest::Begin(&agent.parameters);
        process.ask::<Ready>(begin(&told), &what, monitor)?;
        let mut predicted = ProgramPredictions { values: vec![0.0; wanted.steps], updates: 0 };
        for piece in wanted.stream.pieces() {
            if piece.start >= wanted.steps {
                break;
            }
            // Includes the state after the last step, to which that step leads.
            let piece = piece.start..piece.end.min(wanted.steps + 1);
            for first in piece.clone().step_by(self.states_per_message) {
                let part = first..piece.end.min(first + self.states_per_message);
                let what = LastRequest::States(part.clone());
                let message = states(wanted.stream, &part, &piece);
                let answer: Predictions = process.ask(message, &what, monitor)?;
                predicted.updates = answer.updates;
                let got = answer.finite();
                let is_diverged = got.len() < part.len().min(answer.predictions.len());
                if answer.predictions.len() > part.len()
                    || (got.len() != part.len() && !is_diverged)
                {
                    let got = answer.predictions.len();
                    let wanted = part.len();
                    let command = self.program.shown();
                    return Err(failed(ProgramError::Count { command, got, wanted }));
                }
                // The last state of a piece does not count, because no step begins there.
                let counted = part.start..part.end.min(piece.end - 1);
                for (t, value) in counted.clone().zip(&got) {
                    predicted.values[t] = *value;
                }
                if is_diverged && counted.contains(&(part.start + got.len())) {
                    predicted.values[part.start + got.len()] = f32::NAN;
                    return Ok(predicted);
                }
            }
        }
        Ok(predicted)
    }
}

impl Program for ExternalAgents {
    fn fingerprint(&self) -> &Fingerprint {
        self.program.fingerprint()
    }

    fn predictions(
        &self,
        wanted: &PredictionRequest<'_>,
        monitor: &dyn Monitor,
    ) -> Result<Vec<ProgramPredictions>, ProgramStopped> {
        let mut process =
            Process::start(&self.program, PREDICTION_BYTES * self.states_per_message)?;
        let agents = wanted.agents.iter();
        let all = agents
            .map(|agent| self.predicted(&mut process, wanted, agent, monitor))
            .collect::<Result<Vec<_>, _>>()?;
        process.finish()?;
        self.program.check_unchanged()?;
        Ok(all)
    }
}

/// The last request to the program, for error messages.
enum LastRequest<'a> {
    Begin(&'a std::collections::BTreeMap<String, serde_json::Value>),
    States(Range<usize>),
}

impl fmt::Display for LastRequest<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Begin(parameters) => {
                let parameters = serde_json::to_string(parameters).unwrap_or_default();
                write!(f, "the beginning of a run with the parameters {parameters}")
            }
            Self::States(part) => write!(f, "states {} to {}", part.start, part.end - 1),
        }
    }
}

#[cfg(test)]
mod tests;
