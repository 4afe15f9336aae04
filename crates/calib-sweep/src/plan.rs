use std::collections::BTreeMap;

use calib_agent::{AgentConfig, Part};
use calib_core::{Monitor, Seed};
use calib_files::{Fingerprint, Fingerprinter};
use rayon::prelude::*;
use serde::Serialize;

use crate::{
    Candidate, Environment, EnvironmentId, PlannedUnit, Span, Start, SweepError, Unit, UnitResult,
    UnitStore, WORK_BETWEEN,
    halving::{Halving, Survivors},
    pass::Pass,
};

/// What holds for every unit of a plan.
#[derive(Clone, Copy, Debug)]
pub struct PlanOptions {
    /// The part of a run by which values are dropped, where they are.
    pub part: Part,
    /// How long streams are.
    pub span: Span,
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
    halving: Option<Halving>,
}

/// A sweep that is complete.
#[derive(Clone, Debug, PartialEq)]
pub struct Completed {
    /// Every result, in the order of the units.
    pub results: Vec<UnitResult>,
    /// Units that had to be run for it.
    pub ran: usize,
}

/// Add what `store` has of `jobs` to `found`.
fn read(jobs: &[Job<'_>], found: &mut BTreeMap<Unit, UnitResult>, store: &UnitStore) {
    let read: Vec<UnitResult> = jobs
        .par_iter()
        .filter(|job| !found.contains_key(&job.unit))
        .filter_map(|job| store.get(&job.unit, &job.key))
        .collect();
    found.extend(read.into_iter().map(|result| (result.unit.clone(), result)));
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
        Self { candidates, environments, sensors, starts, options, work_between, halving: None }
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

    /// The same plan that drops values after `rungs` runs of every member; see [`HalvingConfig`](crate::HalvingConfig).
    #[must_use]
    pub fn halving(mut self, keep: f64, rungs: Vec<usize>) -> Self {
        self.halving = Some(Halving { keep, rungs });
        self
    }

    /// Units in all.
    pub fn count(&self) -> usize {
        let runs: usize = self.environments.iter().map(|environment| environment.runs()).sum();
        runs * self.sensors.len()
    }

    /// Units whose values are known before any has been run, which are all units unless values are
    /// dropped: sensor by sensor, environment by environment, run by run.
    pub fn units(&self) -> Vec<PlannedUnit> {
        let planned = |job: Job<'_>| PlannedUnit { unit: job.unit, key: job.key };
        self.jobs(&Survivors::default()).into_iter().map(planned).collect()
    }

    /// The results that `store` has.
    pub fn stored(&self, store: &UnitStore) -> BTreeMap<Unit, UnitResult> {
        let mut found = BTreeMap::new();
        let mut survivors = Survivors::default();
        loop {
            read(&self.jobs(&survivors), &mut found, store);
            if !self.decide(&mut survivors, &found) {
                return found;
            }
        }
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
        Ok(self.complete(self.stored(store), store, monitor)?.results)
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
        stored: BTreeMap<Unit, UnitResult>,
        store: &UnitStore,
        monitor: &dyn Monitor,
    ) -> Result<Completed, SweepError> {
        let (mut found, mut ran) = (stored, 0);
        monitor.begin("training", (self.passes(&found) * self.options.span.steps) as u64);
        let mut survivors = Survivors::default();
        loop {
            let jobs = self.jobs(&survivors);
            // Values of later runs were not known before; what is stored of them is not run again.
            let before = self.passes(&found);
            read(&jobs, &mut found, store);
            let spared = before - self.passes(&found);
            monitor.advance((spared * self.options.span.steps) as u64);
            let trained = self.train(&jobs, &found, store, monitor)?;
            ran += trained.len();
            found.extend(trained.into_iter().map(|result| (result.unit.clone(), result)));
            if !self.decide(&mut survivors, &found) {
                store.forget_unfinished();
                let results = jobs.iter().filter_map(|job| found.remove(&job.unit)).collect();
                return Ok(Completed { results, ran });
            }
        }
    }

    /// Passes over streams that are still to be made beside `found`: sensors share those of a run.
    pub fn passes(&self, found: &BTreeMap<Unit, UnitResult>) -> usize {
        let lacks = |&(environment, run): &(EnvironmentId, usize)| {
            let unit = |sensor: &String| Unit { sensor: sensor.clone(), environment, run };
            self.sensors.iter().any(|(sensor, _)| !found.contains_key(&unit(sensor)))
        };
        let runs = self
            .environments
            .iter()
            .flat_map(|environment| (0..environment.runs()).map(|run| (environment.id(), run)));
        runs.filter(lacks).count()
    }

    /// Run those of `jobs` that have no result, in parallel.
    fn train(
        &self,
        jobs: &[Job<'_>],
        found: &BTreeMap<Unit, UnitResult>,
        store: &UnitStore,
        monitor: &dyn Monitor,
    ) -> Result<Vec<UnitResult>, SweepError> {
        let mut missing: BTreeMap<(EnvironmentId, usize), Vec<&Job<'_>>> = BTreeMap::new();
        for job in jobs.iter().filter(|job| !found.contains_key(&job.unit)) {
            missing.entry((job.unit.environment, job.unit.run)).or_default().push(job);
        }
        let missing: Vec<Vec<&Job<'_>>> = missing.into_values().collect();
        let trained = missing
            .into_par_iter()
            .with_max_len(1)
            .map(|jobs| {
                if monitor.interrupted() {
                    return Err(SweepError::Interrupted);
                }
                Pass { jobs, options: &self.options, work_between: self.work_between }
                    .run(store, monitor)
            })
            .collect::<Result<Vec<_>, _>>()?;
        Ok(trained.into_iter().flatten().collect())
    }

    /// Decide what the results allow to decide; whether that was anything.
    fn decide(&self, survivors: &mut Survivors, found: &BTreeMap<Unit, UnitResult>) -> bool {
        let Some(halving) = &self.halving else { return false };
        let members: Vec<usize> = self
            .environments
            .iter()
            .filter_map(|environment| match environment.id() {
                EnvironmentId::Member(member) => Some(member),
                EnvironmentId::Online | EnvironmentId::LogReplay => None,
            })
            .collect();
        let mut decided = false;
        for (sensor, _) in &self.sensors {
            decided |= survivors.decide(
                halving,
                sensor,
                &members,
                (self.options.part, self.default()),
                found,
            );
        }
        decided
    }

    /// Position of the default.
    fn default(&self) -> Option<usize> {
        self.candidates.iter().position(|candidate| candidate.is_default)
    }

    /// Rungs that have been passed before `run` of a member.
    fn rungs_before(&self, environment: EnvironmentId, run: usize) -> usize {
        match (&self.halving, environment) {
            (Some(halving), EnvironmentId::Member(_)) => {
                halving.rungs.iter().filter(|&&rung| rung <= run).count()
            }
            _ => 0,
        }
    }

    /// The units whose values are known when `survivors` are.
    fn jobs(&self, survivors: &Survivors) -> Vec<Job<'_>> {
        let mut jobs = Vec::new();
        for (sensor, column) in &self.sensors {
            for &environment in &self.environments {
                for run in 0..environment.runs() {
                    let inputs = environment.inputs(run);
                    let rungs = self.rungs_before(environment.id(), run);
                    if rungs > survivors.decided(sensor) {
                        continue;
                    }
                    let agents: Vec<&Candidate> = self
                        .candidates
                        .iter()
                        .filter(|candidate| survivors.contains(sensor, rungs, candidate.index))
                        .collect();
                    let unit = Unit { sensor: sensor.clone(), environment: environment.id(), run };
                    let seed =
                        self.options.seed.child(&environment.id().to_string()).number(run as u64);
                    let start = self.starts.get(sensor);
                    let key = self.key(&unit, *column, &agents, start, seed, &inputs);
                    jobs.push(Job { unit, environment, column: *column, agents, start, seed, key });
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
            span: Span,
            curve_points: usize,
            seed: Seed,
            inputs: &'k Fingerprint,
            #[serde(skip_serializing_if = "Option::is_none")]
            start: Option<&'k Fingerprint>,
        }
        let key = Key {
            format: 4,
            unit,
            column,
            agents: agents.iter().map(|agent| (agent.index, &agent.agent)).collect(),
            span: self.options.span,
            curve_points: self.options.curve_points,
            seed,
            inputs,
            start: start.map(|start| &start.fingerprint),
        };
        let text = serde_json::to_vec(&key).unwrap_or_else(|_| unreachable!("plain data"));
        Fingerprinter::default().add(&text).finish().to_string()
    }
}
