use std::collections::{BTreeMap, BTreeSet};

use calib_agent::{Accelerator, Part};
use calib_core::{Monitor, Seed};
use rayon::prelude::*;

use crate::{
    Baselines, Candidate, Environment, EnvironmentId, PlannedUnit, Program, Span, Start,
    SweepError, Unit, UnitResult, UnitStore, WORK_BETWEEN, cohorts,
    pass::Pass,
    race::{Race, RaceRule, Streams},
};

mod key;
mod part;

pub use part::{PassId, Ready};

/// Version of what units come to. It is raised when the same inputs give other bytes, whatever the reason, so that results
/// of two versions of calib never stand beside each other.
pub const RESULT_VERSION: u32 = 4;

/// What looks a result up by its unit and key.
type Lookup<'l> = &'l (dyn Fn(&Unit, &str) -> Option<UnitResult> + Sync);

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
    /// The log that the baselines of agents are fitted on.
    baselines: Option<&'a Baselines<'a>>,
    /// What trains agents, if not calib.
    program: Option<&'a dyn Program>,
    /// What makes their products, if not calib.
    accelerator: Option<&'a dyn Accelerator>,
    options: PlanOptions,
    work_between: u64,
    race: Option<Race>,
}

/// A sweep that is complete.
#[derive(Clone, Debug, PartialEq)]
pub struct Completed {
    /// Every result, in the order of the units.
    pub results: Vec<UnitResult>,
    /// Units that had to be run for it.
    pub ran: usize,
}

/// Add what `look_up` finds of `jobs` to `found`.
fn read(jobs: &[Job<'_>], found: &mut BTreeMap<Unit, UnitResult>, look_up: Lookup<'_>) {
    let read: Vec<UnitResult> = jobs
        .par_iter()
        .filter(|job| !found.contains_key(&job.unit))
        .filter_map(|job| look_up(&job.unit, &job.key))
        .collect();
    found.extend(read.into_iter().map(|result| (result.unit.clone(), result)));
}

/// The values that are left after each round of a race, for each sensor.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Survivors(BTreeMap<String, Vec<BTreeSet<usize>>>);

impl Survivors {
    fn rounds(&self, sensor: &str) -> &[BTreeSet<usize>] {
        self.0.get(sensor).map_or(&[], Vec::as_slice)
    }
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
        Self {
            candidates,
            environments,
            sensors,
            starts: BTreeMap::new(),
            baselines: None,
            program: None,
            accelerator: None,
            options,
            work_between: WORK_BETWEEN,
            race: None,
        }
    }

    /// The same plan for agents of a program, if there is one.
    #[must_use]
    pub fn by(mut self, program: Option<&'a dyn Program>) -> Self {
        self.program = program;
        self
    }

    /// The same plan with passes side by side on an accelerator, if there is one. Its results are not those of a plan without.
    #[must_use]
    pub fn on(mut self, accelerator: Option<&'a dyn Accelerator>) -> Self {
        self.accelerator = accelerator;
        self
    }

    /// The same plan for agents that start from checkpoints, one a sensor.
    #[must_use]
    pub fn starting_from(mut self, starts: BTreeMap<String, Start>) -> Self {
        self.starts = starts;
        self
    }

    /// The same plan for agents whose baselines are fitted on a log.
    #[must_use]
    pub fn with_baselines(mut self, baselines: Option<&'a Baselines<'a>>) -> Self {
        self.baselines = baselines;
        self
    }

    /// The same plan that keeps the state of long runs after this much work instead of [`WORK_BETWEEN`].
    /// Results do not depend on it.
    #[must_use]
    pub fn keeping_after(mut self, work_between: u64) -> Self {
        self.work_between = work_between;
        self
    }

    /// The same plan as a race: after each round values that are behind are dropped, by `rule`, and a sensor makes no more runs once one
    /// value is left. Online always trains all values. Every run that is made is the one that it would be without the race.
    ///
    /// # Errors
    /// An error rate that is not above 0 and at most 0.5.
    pub fn race(mut self, rule: RaceRule) -> Result<Self, SweepError> {
        let mut streams = Streams { members: Vec::new(), runs: usize::MAX, windows: 0 };
        for environment in &self.environments {
            match environment.id() {
                EnvironmentId::Member(member) => {
                    streams.members.push(member);
                    streams.runs = streams.runs.min(environment.runs());
                }
                EnvironmentId::LogReplay => streams.windows += environment.runs(),
                EnvironmentId::Online => {}
            }
        }
        if streams.members.is_empty() {
            streams.runs = 0;
        }
        let race = Race::new(&streams, self.candidates.len(), self.options.part, rule)?;
        self.race = Some(race);
        Ok(self)
    }

    /// Units in all, as many as there can be.
    pub fn count(&self) -> usize {
        let runs: usize = self.environments.iter().map(|environment| environment.runs()).sum();
        runs * self.sensors.len()
    }

    /// Units whose values are known before any has been run, which are all units but in a race: sensor by sensor, environment by
    /// environment, run by run.
    pub fn units(&self) -> Vec<PlannedUnit> {
        let planned = |job: Job<'_>| PlannedUnit { unit: job.unit, key: job.key };
        self.jobs(&Survivors::default()).into_iter().map(planned).collect()
    }

    /// The results that `store` has.
    ///
    /// # Errors
    /// If an error that a race decides by is NaN.
    pub fn stored(&self, store: &UnitStore) -> Result<BTreeMap<Unit, UnitResult>, SweepError> {
        self.known(&|unit, key| store.get(unit, key))
    }

    /// The results that `look_up` finds by unit and key.
    ///
    /// # Errors
    /// As [`stored`](Self::stored).
    pub fn known(&self, look_up: Lookup<'_>) -> Result<BTreeMap<Unit, UnitResult>, SweepError> {
        let mut found = BTreeMap::new();
        let mut survivors = Survivors::default();
        loop {
            read(&self.jobs(&survivors), &mut found, look_up);
            if !self.decide(&mut survivors, &found)? {
                return Ok(found);
            }
        }
    }

    /// Units that have to be run beside `found`; in a race, at most.
    ///
    /// # Errors
    /// As [`stored`](Self::stored).
    pub fn left(&self, found: &BTreeMap<Unit, UnitResult>) -> Result<usize, SweepError> {
        Ok(self.missing(found)?.len())
    }

    /// Units that have to be run beside `found`; in a race, at most.
    fn missing(&self, found: &BTreeMap<Unit, UnitResult>) -> Result<Vec<Unit>, SweepError> {
        let mut survivors = Survivors::default();
        self.decide(&mut survivors, found)?;
        let mut missing = Vec::new();
        for (sensor, _) in &self.sensors {
            for environment in &self.environments {
                for run in 0..environment.runs() {
                    let unit = Unit { sensor: sensor.clone(), environment: environment.id(), run };
                    if !self.is_spared(&unit, &survivors) && !found.contains_key(&unit) {
                        missing.push(unit);
                    }
                }
            }
        }
        Ok(missing)
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
        Ok(self.complete(self.stored(store)?, store, monitor)?.results)
    }

    /// Run the units that have no result in `stored`, in parallel, put their results in `store`, and return
    /// all results in the order of [`units`](Self::units). Results do not depend on the number of threads.
    ///
    /// The units of one run in one environment share a pass over its stream, whatever sensor they predict.
    /// Long passes keep their state in the store, so that a killed one goes on in the middle.
    ///
    /// # Errors
    /// The first failure, or [`SweepError::Cancelled`]; finished units stay stored.
    pub fn complete(
        &self,
        stored: BTreeMap<Unit, UnitResult>,
        store: &UnitStore,
        monitor: &dyn Monitor,
    ) -> Result<Completed, SweepError> {
        let (mut found, mut ran, kept) = (stored, 0, store.states_kept());
        let mut left = self.passes(&found)?;
        monitor.begin("training", (left * self.options.span.steps) as u64);
        let mut survivors = Survivors::default();
        loop {
            let jobs = self.jobs(&survivors);
            // Values of later runs were not known before: what is stored of them is not run again, and some are not needed.
            read(&jobs, &mut found, &|unit, key| store.get(unit, key));
            let now = self.passes(&found)?;
            // Sensors need not have come equally far before, so that one pass can train units of several rounds.
            let done = left.saturating_sub(now);
            monitor.advance((done * self.options.span.steps) as u64);
            let trained = self.train(&jobs, &found, store, monitor)?;
            ran += trained.len();
            left = now.saturating_sub(Self::passes_of(&trained));
            found.extend(trained.into_iter().map(|result| (result.unit.clone(), result)));
            if !self.decide(&mut survivors, &found)? {
                store.forget_stale(&kept);
                let results = jobs.iter().filter_map(|job| found.remove(&job.unit)).collect();
                return Ok(Completed { results, ran });
            }
        }
    }

    /// Passes over streams that are still to be made beside `found`, in a race at most: sensors share those of a run.
    ///
    /// # Errors
    /// As [`stored`](Self::stored).
    pub fn passes(&self, found: &BTreeMap<Unit, UnitResult>) -> Result<usize, SweepError> {
        Ok(Self::passes_over(self.missing(found)?.iter()))
    }

    fn passes_of(results: &[UnitResult]) -> usize {
        Self::passes_over(results.iter().map(|result| &result.unit))
    }

    fn passes_over<'u>(units: impl Iterator<Item = &'u Unit>) -> usize {
        units.map(|unit| (unit.environment, unit.run)).collect::<BTreeSet<_>>().len()
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
        let missing: Vec<Pass<'_, '_>> =
            missing.into_values().map(|jobs| self.pass(jobs)).collect();
        if let Some(accelerator) = self.accelerator {
            return cohorts::run(&missing, accelerator, store, monitor);
        }
        let trained = missing
            .into_par_iter()
            .with_max_len(1)
            .map(|pass| {
                monitor.check()?;
                pass.run(store, monitor)
            })
            .collect::<Result<Vec<_>, _>>()?;
        Ok(trained.into_iter().flatten().collect())
    }

    /// A pass of these jobs.
    fn pass<'p>(&'p self, jobs: Vec<&'p Job<'a>>) -> Pass<'p, 'a> {
        Pass {
            jobs,
            program: self.program,
            baselines: self.baselines,
            options: &self.options,
            work_between: self.work_between,
        }
    }

    /// Decide what the results allow to decide; whether that was anything.
    fn decide(
        &self,
        survivors: &mut Survivors,
        found: &BTreeMap<Unit, UnitResult>,
    ) -> Result<bool, SweepError> {
        let Some(race) = &self.race else { return Ok(false) };
        let mut decided = false;
        for (sensor, _) in &self.sensors {
            let after = race.survivors(sensor, found)?;
            decided |= after.len() > survivors.rounds(sensor).len();
            survivors.0.insert(sensor.clone(), after);
        }
        Ok(decided)
    }

    /// The round of the race before that of a unit; none if it is made whatever happens.
    fn round_before(&self, unit: &Unit) -> Option<usize> {
        self.race.as_ref()?.round(unit.environment, unit.run)?.checked_sub(1)
    }

    /// Whether one value is left before the round of a unit.
    fn is_spared(&self, unit: &Unit, survivors: &Survivors) -> bool {
        let rounds = survivors.rounds(&unit.sensor);
        let over = |round: usize| rounds.iter().take(round + 1).any(|left| left.len() < 2);
        self.round_before(unit).is_some_and(over)
    }

    /// The units whose values are known when `survivors` are.
    fn jobs(&self, survivors: &Survivors) -> Vec<Job<'_>> {
        self.jobs_of(survivors, &|_| true)
    }

    /// Those of them that are `wanted`.
    fn jobs_of(&self, survivors: &Survivors, wanted: &dyn Fn(&Unit) -> bool) -> Vec<Job<'_>> {
        let mut jobs = Vec::new();
        for (sensor, column) in &self.sensors {
            for &environment in &self.environments {
                for run in 0..environment.runs() {
                    let unit = Unit { sensor: sensor.clone(), environment: environment.id(), run };
                    let before = self.round_before(&unit);
                    let rounds = survivors.rounds(sensor);
                    if !wanted(&unit)
                        || self.is_spared(&unit, survivors)
                        || before.is_some_and(|round| round >= rounds.len())
                    {
                        continue;
                    }
                    let left = before.map(|round| &rounds[round]);
                    let agents: Vec<&Candidate> = self
                        .candidates
                        .iter()
                        .filter(|candidate| left.is_none_or(|left| left.contains(&candidate.index)))
                        .collect();
                    let inputs = environment.inputs(run);
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
}
