//! Agents of another program: it is started for each unit, reads states and answers with predictions. `docs/guides/external-agents.md` is
//! what its author reads.

mod error;
#[cfg(target_os = "linux")]
mod guard;
mod message;
mod process;

use std::{
    fmt,
    ops::Range,
    path::{Path, PathBuf, absolute},
    time::Duration,
};

use calib_agent::AgentConfig;
use calib_base::{Context as _, StepError};
use calib_core::Monitor;
use calib_files::{Fingerprint, Fingerprinter, fingerprint_file};
use calib_study::Job;
use calib_sweep::{PredictionRequest, Program, ProgramPredictions, ProgramStopped};

use error::{ProgramError, failed};
use message::{Begin, Predictions, Ready, begin, states};
use process::Process;

/// The program of a study.
#[derive(Debug)]
pub(crate) struct ExternalAgents {
    command: Vec<String>,
    /// Where it is started: that of the study.
    folder: PathBuf,
    states_per_message: usize,
    /// How long an answer may take.
    timeout: Duration,
    fingerprint: Fingerprint,
}

impl ExternalAgents {
    /// That of a study, if its agents are those of a program.
    ///
    /// # Errors
    /// If a file that the command names cannot be read.
    pub(crate) fn of(job: &Job) -> Result<Option<Self>, StepError> {
        let AgentConfig { command, states_per_message, timeout_secs, .. } = &job.study().agent;
        if !job.study().agent.is_external() {
            return Ok(None);
        }
        let folder = job.layout().study().parent().unwrap_or(Path::new(""));
        let folder = absolute(folder.join("."))
            .with_context(|| format!("the folder of {}", job.layout().study().display()))?;
        Ok(Some(Self {
            command: command.clone(),
            fingerprint: fingerprint(command, &folder)?,
            folder,
            states_per_message: *states_per_message,
            timeout: Duration::from_secs_f64(*timeout_secs),
        }))
    }

    /// What one agent predicts, told by the program.
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
            // The state after the last step is what that step leads to.
            let piece = piece.start..piece.end.min(wanted.steps + 1);
            for first in piece.clone().step_by(self.states_per_message) {
                let part = first..piece.end.min(first + self.states_per_message);
                let what = LastRequest::States(part.clone());
                let message = states(wanted.stream, &part, &piece);
                let answer: Predictions = process.ask(message, &what, monitor)?;
                predicted.updates = answer.updates;
                let got = answer.finite();
                let is_diverged = got.len() < part.len() && answer.ends_early();
                if answer.predictions.len() > part.len()
                    || (got.len() != part.len() && !is_diverged)
                {
                    let got = answer.predictions.len();
                    let wanted = part.len();
                    return Err(failed(ProgramError::Count { command: self.shown(), got, wanted }));
                }
                // The last of a piece does not count: no step begins there.
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

    /// As one would type it.
    fn shown(&self) -> String {
        calib_study::shell_words(self.command.iter().cloned())
    }
}

impl Program for ExternalAgents {
    fn fingerprint(&self) -> &Fingerprint {
        &self.fingerprint
    }

    fn predictions(
        &self,
        wanted: &PredictionRequest<'_>,
        monitor: &dyn Monitor,
    ) -> Result<Vec<ProgramPredictions>, ProgramStopped> {
        let mut process = Process::start(self).map_err(failed)?;
        let agents = wanted.agents.iter();
        let all = agents
            .map(|agent| self.predicted(&mut process, wanted, agent, monitor))
            .collect::<Result<Vec<_>, _>>()?;
        process.finish().map_err(failed)?;
        // Each unit starts the files that are there then: what others made must have started the same.
        let same =
            fingerprint(&self.command, &self.folder).is_ok_and(|now| now == self.fingerprint);
        if same { Ok(all) } else { Err(failed(ProgramError::Changed { command: self.shown() })) }
    }
}

/// What the program was asked for last.
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

/// Whether the first word of a command is a path, and not a name that the system looks up.
fn is_path(program: &str) -> bool {
    Path::new(program).components().count() > 1
}

/// Of a command, and of the content of each file that it names.
fn fingerprint(command: &[String], folder: &Path) -> Result<Fingerprint, StepError> {
    let mut all = Fingerprinter::default();
    for (place, word) in command.iter().enumerate() {
        all.add(word.as_bytes());
        let path = folder.join(word);
        if (place > 0 || is_path(word)) && path.is_file() {
            all.add(fingerprint_file(&path)?.as_str().as_bytes());
        }
    }
    Ok(all.finish())
}

#[cfg(test)]
mod tests;
