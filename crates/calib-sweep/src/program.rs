use std::{error::Error, fmt};

use calib_agent::{AgentConfig, CurveRule, RunOutcome, score_predictions};
use calib_core::{Cancelled, Monitor, Seed, Stream};
use calib_files::Fingerprint;

use crate::{PlanOptions, SweepError, Unit, plan::UnitJob};

/// An external program whose agents learn in place of calib's own.
///
/// Its agents predict at every state of a stream, in time order. At state t an agent knows only the states up to t.
/// Calib scores the predictions.
pub trait Program: fmt::Debug + Sync {
    /// Returns the fingerprint of the program's content, as far as calib can see it.
    fn fingerprint(&self) -> &Fingerprint;

    /// Returns the predictions of every agent, in the order of `wanted.agents`.
    ///
    /// # Errors
    /// Returns an error if the program fails, or the monitor is interrupted.
    fn predictions(
        &self,
        wanted: &PredictionRequest<'_>,
        monitor: &dyn Monitor,
    ) -> Result<Vec<ProgramPredictions>, ProgramStopped>;
}

/// A request for the agents of a program to predict the returns of a column on a stream.
pub struct PredictionRequest<'w> {
    /// The predicted sensor.
    pub sensor: &'w str,
    /// Its column of the states.
    pub column: usize,
    /// The agents. They are independent, and each is trained from the start of the stream.
    pub agents: Vec<&'w AgentConfig>,
    /// The seed for all agents: common random numbers.
    pub seed: Seed,
    /// The states.
    pub stream: &'w dyn Stream,
    /// Number of predictions per agent, one for each of the first states. The stream has more states.
    pub steps: usize,
}

/// The predictions of one agent of a program.
#[derive(Clone, Debug, PartialEq)]
pub struct ProgramPredictions {
    /// One value per step, in normalised units. The last value of an unbroken piece does not count. Values after the
    /// first one that is not finite do not count either.
    pub values: Vec<f32>,
    /// Number of updates that the program reports.
    pub updates: u64,
}

/// The reason why a program gave no predictions.
#[derive(Debug)]
pub enum ProgramStopped {
    /// The observer asked to stop.
    Cancelled(Cancelled),
    /// The program failed.
    Failed(Box<dyn Error + Send + Sync>),
    /// The program cannot answer this request. It may answer others.
    CannotAnswer(Box<dyn Error + Send + Sync>),
}

/// Returns the outcomes of the agents of all jobs over a stream, in the order of the jobs and their agents.
pub(crate) fn outcomes(
    program: &dyn Program,
    jobs: &[&UnitJob<'_>],
    stream: &dyn Stream,
    options: &PlanOptions,
    monitor: &dyn Monitor,
) -> Result<Vec<RunOutcome>, SweepError> {
    let steps = options.span.steps_in(stream.len());
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
