use calib_agent::AgentConfig;
use calib_core::{Monitor, Seed};
use calib_files::{Fingerprint, Fingerprinter};
use rayon::prelude::*;
use serde::Serialize;

use crate::{
    Candidate, Environment, EnvironmentId, Role, Scored, SweepError, Unit, UnitResult, UnitStore,
    unit::{PlannedUnit, train_unit},
};

/// What holds for every unit of a plan.
#[derive(Clone, Copy, Debug)]
pub struct PlanOptions {
    /// Which steps count.
    pub scored: Scored,
    /// Steps of every stream; they measure progress.
    pub steps: usize,
    /// Points of each learning curve.
    pub curve_points: usize,
    /// Root of the agents' seeds.
    pub seed: Seed,
}

/// Every unit of a sweep, in a fixed order.
pub struct Plan<'a> {
    candidates: &'a [Candidate],
    environments: Vec<&'a dyn Environment>,
    /// Name and column of each predicted sensor.
    sensors: Vec<(String, usize)>,
    options: PlanOptions,
}

/// A unit with what is needed to run it.
struct Job<'a> {
    unit: Unit,
    environment: &'a dyn Environment,
    column: usize,
    agents: Vec<&'a Candidate>,
    seed: Seed,
    key: String,
}

impl<'a> Plan<'a> {
    /// The plan that trains `candidates` on `sensors` (name and column) in `environments`.
    pub fn new(
        candidates: &'a [Candidate],
        environments: Vec<&'a dyn Environment>,
        sensors: Vec<(String, usize)>,
        options: PlanOptions,
    ) -> Self {
        Self { candidates, environments, sensors, options }
    }

    /// All units with their keys: sensor by sensor, environment by environment, run by run.
    pub fn units(&self) -> Vec<PlannedUnit> {
        let planned = |job: Job<'_>| PlannedUnit { unit: job.unit, key: job.key };
        self.jobs().into_iter().map(planned).collect()
    }

    /// The result that `store` has for each of [`units`](Self::units).
    pub fn stored(&self, store: &UnitStore) -> Vec<Option<UnitResult>> {
        self.jobs().par_iter().map(|job| store.get(&job.unit, &job.key)).collect()
    }

    /// Run what `store` lacks; see [`complete`](Self::complete).
    ///
    /// # Errors
    /// As [`complete`](Self::complete).
    pub fn run(
        &self,
        store: &UnitStore,
        monitor: &dyn Monitor,
    ) -> Result<Vec<UnitResult>, SweepError> {
        self.complete(self.stored(store), store, monitor)
    }

    /// Run the units that have no result in `stored`, in parallel, put their results in `store`, and return
    /// all results in the order of [`units`](Self::units). Results do not depend on the number of threads.
    ///
    /// # Errors
    /// The first failure, or [`SweepError::Interrupted`]; finished units stay stored.
    pub fn complete(
        &self,
        stored: Vec<Option<UnitResult>>,
        store: &UnitStore,
        monitor: &dyn Monitor,
    ) -> Result<Vec<UnitResult>, SweepError> {
        let jobs = self.jobs();
        let missing = stored.iter().filter(|result| result.is_none()).count();
        // Agents count the states of a stream: one more than its steps.
        monitor.begin("training", missing as u64 * (self.options.steps as u64 + 1));
        jobs.par_iter()
            .zip(stored)
            .with_max_len(1)
            .map(|(job, stored)| {
                if let Some(result) = stored {
                    return Ok(result);
                }
                if monitor.interrupted() {
                    return Err(SweepError::Interrupted);
                }
                let result = self.run_job(job, monitor)?;
                store.put(&result)?;
                Ok(result)
            })
            .collect()
    }

    fn run_job(&self, job: &Job<'_>, monitor: &dyn Monitor) -> Result<UnitResult, SweepError> {
        let (stream, start) = job.environment.stream(job.unit.run)?;
        let rows = train_unit(
            &job.unit,
            &*stream,
            job.column,
            &job.agents,
            &self.options,
            job.seed,
            monitor,
        )?;
        Ok(UnitResult {
            key: job.key.clone(),
            unit: job.unit.clone(),
            seed: job.seed.get(),
            start_row: start.0,
            rows,
        })
    }

    fn jobs(&self) -> Vec<Job<'a>> {
        let mut jobs = Vec::new();
        for (sensor, column) in &self.sensors {
            for &environment in &self.environments {
                let agents: Vec<&Candidate> = self
                    .candidates
                    .iter()
                    .filter(|candidate| {
                        candidate.role == Role::Grid || environment.id() == EnvironmentId::Online
                    })
                    .collect();
                let inputs = environment.inputs();
                for run in 0..environment.runs() {
                    let unit = Unit { sensor: sensor.clone(), environment: environment.id(), run };
                    let seed =
                        self.options.seed.child(&environment.id().to_string()).number(run as u64);
                    let key = self.key(&unit, *column, &agents, seed, &inputs);
                    jobs.push(Job {
                        unit,
                        environment,
                        column: *column,
                        agents: agents.clone(),
                        seed,
                        key,
                    });
                }
            }
        }
        jobs
    }

    /// Fingerprint of everything that a unit's result follows from.
    fn key(
        &self,
        unit: &Unit,
        column: usize,
        agents: &[&Candidate],
        seed: Seed,
        inputs: &Fingerprint,
    ) -> String {
        #[derive(Serialize)]
        struct Key<'k> {
            format: u32,
            unit: &'k Unit,
            column: usize,
            agents: Vec<(usize, &'k AgentConfig)>,
            scored: Scored,
            steps: usize,
            curve_points: usize,
            seed: Seed,
            inputs: &'k Fingerprint,
        }
        let key = Key {
            format: 2,
            unit,
            column,
            agents: agents.iter().map(|agent| (agent.index, &agent.agent)).collect(),
            scored: self.options.scored,
            steps: self.options.steps,
            curve_points: self.options.curve_points,
            seed,
            inputs,
        };
        let text = serde_json::to_vec(&key).unwrap_or_else(|_| unreachable!("plain data"));
        Fingerprinter::default().add(&text).finish().to_string()
    }
}
