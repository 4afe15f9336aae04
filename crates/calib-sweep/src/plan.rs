use std::collections::BTreeMap;

use calib_agent::AgentConfig;
use calib_core::{Monitor, Seed};
use calib_files::{Fingerprint, Fingerprinter};
use rayon::prelude::*;
use serde::Serialize;

use crate::{
    Candidate, Environment, EnvironmentId, PlannedUnit, Role, Scored, Start, SweepError, Unit,
    UnitResult, UnitStore, WORK_BETWEEN, pass::Pass,
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
    /// What the agents of a sensor start from, where they were pre-trained.
    starts: BTreeMap<String, Start>,
    options: PlanOptions,
    work_between: u64,
}

/// A unit with what is needed to run it.
pub(crate) struct Job<'a> {
    pub(crate) unit: Unit,
    pub(crate) environment: &'a dyn Environment,
    pub(crate) column: usize,
    pub(crate) agents: Vec<&'a Candidate>,
    pub(crate) start: Option<&'a Start>,
    pub(crate) seed: Seed,
    pub(crate) key: String,
}

impl<'a> Plan<'a> {
    /// The plan that trains `candidates` on `sensors` (name and column) in `environments`.
    pub fn new(
        candidates: &'a [Candidate],
        environments: Vec<&'a dyn Environment>,
        sensors: Vec<(String, usize)>,
        options: PlanOptions,
    ) -> Self {
        let (starts, work_between) = (BTreeMap::new(), WORK_BETWEEN);
        Self { candidates, environments, sensors, starts, options, work_between }
    }

    /// The same plan for agents that start from checkpoints, one a sensor.
    #[must_use]
    pub fn starting_from(mut self, starts: BTreeMap<String, Start>) -> Self {
        self.starts = starts;
        self
    }

    /// The same plan that keeps the state of long runs after this much work instead of [`WORK_BETWEEN`].
    /// Results do not depend on it.
    #[must_use]
    pub fn keeping_after(mut self, work_between: u64) -> Self {
        self.work_between = work_between;
        self
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
    /// The units of one run in one environment share a pass over its stream, whatever sensor they predict.
    /// Long passes keep their state in the store, so that a killed one goes on in the middle.
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
        let mut results = stored;
        // Sensors of one run share its stream.
        let mut missing: BTreeMap<(EnvironmentId, usize), Vec<usize>> = BTreeMap::new();
        for (index, job) in jobs.iter().enumerate().filter(|&(index, _)| results[index].is_none()) {
            missing.entry((job.unit.environment, job.unit.run)).or_default().push(index);
        }
        // Agents count the states of a stream: one more than its steps.
        monitor.begin("training", missing.len() as u64 * (self.options.steps as u64 + 1));
        let missing: Vec<Vec<usize>> = missing.into_values().collect();
        let trained = missing
            .par_iter()
            .with_max_len(1)
            .map(|pass| {
                if monitor.interrupted() {
                    return Err(SweepError::Interrupted);
                }
                let jobs = pass.iter().map(|&index| &jobs[index]).collect();
                Pass { jobs, options: &self.options, work_between: self.work_between }
                    .run(store, monitor)
            })
            .collect::<Result<Vec<_>, _>>()?;
        for (index, result) in missing.into_iter().flatten().zip(trained.into_iter().flatten()) {
            results[index] = Some(result);
        }
        store.forget_unfinished();
        Ok(results.into_iter().flatten().collect())
    }

    fn jobs(&self) -> Vec<Job<'_>> {
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
                    let start = self.starts.get(sensor);
                    let key = self.key(&unit, *column, &agents, start, seed, &inputs);
                    jobs.push(Job {
                        unit,
                        environment,
                        column: *column,
                        agents: agents.clone(),
                        start,
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
        start: Option<&Start>,
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
            #[serde(skip_serializing_if = "Option::is_none")]
            start: Option<&'k Fingerprint>,
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
            start: start.map(|start| &start.fingerprint),
        };
        let text = serde_json::to_vec(&key).unwrap_or_else(|_| unreachable!("plain data"));
        Fingerprinter::default().add(&text).finish().to_string()
    }
}
