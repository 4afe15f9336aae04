use std::{error::Error, fmt};

use calib_agent::{AgentConfig, CurveRule, RunOutcome, score_predictions};
use calib_core::{Cancelled, Monitor, Seed, Stream};
use calib_files::Fingerprint;

use crate::{PlanOptions, SweepError, Unit, plan::UnitJob};

/// A program whose agents learn in the place of calib's own.
///
/// It has agents predict at every state of a stream, in the order of time: at state t an agent knows the states up to t, and nothing of those
/// after it. Calib scores what they predicted.
pub trait Program: fmt::Debug + Sync {
    /// Of its content, as far as that can be seen.
    fn fingerprint(&self) -> &Fingerprint;

    /// What every agent predicted, in the order of `wanted.agents`.
    ///
    /// # Errors
    /// If the program fails, or the monitor is interrupted.
    fn predictions(
        &self,
        wanted: &PredictionRequest<'_>,
        monitor: &dyn Monitor,
    ) -> Result<Vec<ProgramPredictions>, ProgramStopped>;
}

/// What agents of a program are to predict: the returns of a column on a stream.
pub struct PredictionRequest<'w> {
    /// The predicted sensor.
    pub sensor: &'w str,
    /// Its column of the states.
    pub column: usize,
    /// The agents, one after the other; none knows of another.
    pub agents: Vec<&'w AgentConfig>,
    /// For all of them: common random numbers.
    pub seed: Seed,
    /// The states.
    pub stream: &'w dyn Stream,
    /// Predictions of each agent, one for each of the first states. The stream has more.
    pub steps: usize,
}

/// What an agent of a program predicted.
#[derive(Clone, Debug, PartialEq)]
pub struct ProgramPredictions {
    /// One value a step, in normalised units. The last of an unbroken piece does not count. What comes after the first that is not finite does
    /// not either.
    pub values: Vec<f32>,
    /// Updates, as it says.
    pub updates: u64,
}

/// Why a program gave no predictions.
#[derive(Debug)]
pub enum ProgramStopped {
    /// The observer asked to stop.
    Cancelled(Cancelled),
    /// It failed.
    Failed(Box<dyn Error + Send + Sync>),
    /// It failed at what it was asked. It may answer other questions.
    CannotAnswer(Box<dyn Error + Send + Sync>),
}

/// What the agents of all jobs come to over a stream, in the order of the jobs and their agents.
pub(crate) fn outcomes(
    program: &dyn Program,
    jobs: &[&UnitJob<'_>],
    stream: &dyn Stream,
    options: &PlanOptions,
    monitor: &dyn Monitor,
) -> Result<Vec<RunOutcome>, SweepError> {
    let steps = options.span.steps.min(stream.len().saturating_sub(1));
    let mut all = Vec::new();
    for job in jobs {
        let wanted = PredictionRequest {
            sensor: &job.unit.sensor,
            column: job.column,
            agents: job.agents.iter().map(|candidate| &candidate.agent).collect(),
            seed: job.seed,
            stream,
            steps,
        };
        let predicted =
            program.predictions(&wanted, monitor).map_err(|stopped| of_unit(stopped, &job.unit))?;
        for (agent, ProgramPredictions { values, updates }) in wanted.agents.iter().zip(predicted) {
            let curve = CurveRule { windows: options.curve_points };
            let scored =
                score_predictions(stream, job.column, agent.gamma, &values, updates, curve);
            all.push(
                scored.map_err(|source| SweepError::Agent { unit: job.unit.clone(), source })?,
            );
        }
    }
    monitor.advance(options.span.steps as u64);
    Ok(all)
}

fn of_unit(stopped: ProgramStopped, unit: &Unit) -> SweepError {
    match stopped {
        ProgramStopped::Cancelled(cancelled) => cancelled.into(),
        ProgramStopped::Failed(source) | ProgramStopped::CannotAnswer(source) => {
            SweepError::Program { unit: unit.clone(), source }
        }
    }
}
