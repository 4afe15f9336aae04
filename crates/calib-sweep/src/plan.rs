use std::{
    collections::{BTreeMap, BTreeSet},
    sync::{Arc, OnceLock},
};

use calib_agent::{Accelerator, Part};
use calib_core::{Monitor, Seed};
use rayon::prelude::*;

use crate::{
    Baselines, Candidate, Environment, EnvironmentId, PlannedUnit, Program, Span, Start,
    SweepError, Unit, UnitResult, UnitRuns, UnitStore, WORK_BETWEEN, cohorts, pass::Pass,
    race::Race,
};

mod group;
mod key;
mod part;

pub use group::{PlannedSensor, SensorGroup};
use key::UnitInputs;
pub use part::{PassId, ReadyPass};

/// Version of what units come to. It is raised when the same inputs give other bytes, whatever the reason, so that results
/// of two versions of calib never stand beside each other.
pub const RESULT_VERSION: u32 = 4;

/// What looks the runs of a unit up by unit and key.
type Lookup<'l> = &'l (dyn Fn(&Unit, &str) -> Option<UnitRuns> + Sync);

/// What holds for every unit of a plan.
#[derive(Clone, Copy, Debug)]
pub struct PlanOptions {
    /// The part of a run by which values are dropped, where they are.
    pub part: Part,
    /// How long streams are; of several groups of sensors, the longest.
    pub span: Span,
    /// Points of each learning curve.
    pub curve_points: usize,
    /// Root of the agents' seeds.
    pub seed: Seed,
}

/// Every unit of a sweep, in a fixed order.
pub struct Plan<'a> {
    candidates: &'a [Candidate],
    /// The keys of their settings, once they are known.
    settings: OnceLock<Vec<Arc<str>>>,
    groups: Vec<SensorGroup<'a>>,
    sensors: Vec<PlannedSensor>,
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
    /// The race of each group, if the plan is one.
    races: Option<Vec<Race>>,
}

/// A sweep that is complete.
#[derive(Clone, Debug, PartialEq)]
pub struct CompletedSweep {
    /// Every result, in the order of the units.
    pub results: Vec<UnitResult>,
    /// Units of which something had to be run for it.
    pub ran: usize,
    /// Runs that were made for it: of each unit, one for each setting that had none.
    pub runs: usize,
}

/// What is there of the results of a plan.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StoredUnits {
    /// Units that have a run of every setting.
    whole: BTreeMap<Unit, UnitResult>,
    /// Those runs of other units that are there: a smaller grid has left them.
    begun: BTreeMap<Unit, UnitRuns>,
}

impl StoredUnits {
    /// The results of the units that are whole.
    pub fn whole(&self) -> &BTreeMap<Unit, UnitResult> {
        &self.whole
    }

    /// The runs of those that are not.
    pub fn begun(&self) -> &BTreeMap<Unit, UnitRuns> {
        &self.begun
    }

    /// Add what `look_up` finds of `jobs`.
    fn read(&mut self, jobs: &[UnitJob<'_>], look_up: Lookup<'_>) {
        let read: Vec<(&UnitJob<'_>, UnitRuns)> = jobs
            .par_iter()
            .filter(|job| !self.whole.contains_key(&job.unit))
            .filter_map(|job| Some((job, look_up(&job.unit, &job.key)?)))
            .collect();
        for (job, mut runs) in read {
            runs.runs.retain(|setting, _| job.settings.iter().any(|own| **own == **setting));
            self.add(job, runs);
        }
    }

    /// Add runs of a job, which may make it whole.
    fn add(&mut self, job: &UnitJob<'_>, runs: UnitRuns) {
        if runs.runs.is_empty() {
            return;
        }
        let all = match self.begun.remove(&job.unit) {
            Some(mut begun) => {
                begun.merge(runs);
                begun
            }
            None => runs,
        };
        match all.result(job.trained()) {
            Some(result) => drop(self.whole.insert(job.unit.clone(), result)),
            None => drop(self.begun.insert(job.unit.clone(), all)),
        }
    }

    /// What is left to be trained of a job, if anything is.
    fn rest<'a>(&self, job: &UnitJob<'a>) -> Option<UnitJob<'a>> {
        if self.whole.contains_key(&job.unit) {
            return None;
        }
        let begun = self.begun.get(&job.unit);
        Some(job.of(|setting| begun.is_none_or(|begun| !begun.runs.contains_key(setting))))
    }
}

/// The values that are left after each round of a race, for each sensor.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Survivors(BTreeMap<String, Vec<BTreeSet<usize>>>);

impl Survivors {
    fn rounds(&self, sensor: &str) -> &[BTreeSet<usize>] {
        self.0.get(sensor).map_or(&[], Vec::as_slice)
    }
}

/// The values that are left before a unit.
enum SurvivorsBefore<'s> {
    All,
    Some(&'s BTreeSet<usize>),
    /// The unit is not run.
    One,
    NotKnown,
}

/// A unit with what is needed to run it.
#[derive(Clone)]
pub(crate) struct UnitJob<'a> {
    pub(crate) unit: Unit,
    /// Position of the sensor's group: units of one group share passes.
    group: usize,
    pub(crate) environment: &'a dyn Environment,
    pub(crate) column: usize,
    pub(crate) agents: Vec<&'a Candidate>,
    /// The key of each agent's setting.
    pub(crate) settings: Vec<Arc<str>>,
    /// Positions of the candidates that were dropped before.
    pub(crate) dropped: BTreeSet<usize>,
    pub(crate) start: Option<&'a Start>,
    pub(crate) seed: Seed,
    /// Of everything that its runs follow from beside their settings.
    pub(crate) key: String,
}

impl UnitJob<'_> {
    /// Position and key of each candidate.
    fn trained(&self) -> impl Iterator<Item = (usize, &str)> {
        let settings = self.settings.iter().map(AsRef::as_ref);
        self.agents.iter().map(|agent| agent.index).zip(settings)
    }

    /// The unit, as it is planned.
    fn planned(&self) -> PlannedUnit {
        let Self { unit, key, dropped, .. } = self.clone();
        PlannedUnit { unit, key, dropped }
    }

    /// The same job with those agents only whose settings are `wanted`.
    fn of(&self, wanted: impl Fn(&str) -> bool) -> Self {
        let both = self.agents.iter().zip(&self.settings).filter(|(_, setting)| wanted(setting));
        let (agents, settings) = both.map(|(agent, setting)| (*agent, Arc::clone(setting))).unzip();
        Self { agents, settings, ..self.clone() }
    }
}

impl<'a> Plan<'a> {
    /// The plan that trains `candidates` on `sensors` (name and column) in `environments`.
    pub fn new(
        candidates: &'a [Candidate],
        environments: Vec<&'a dyn Environment>,
        sensors: Vec<(String, usize)>,
        options: PlanOptions,
    ) -> Self {
        let sensors =
            sensors.into_iter().map(|(name, column)| PlannedSensor { name, column, group: 0 });
        let group = SensorGroup { candidates, environments, span: options.span };
        Self::of_groups(candidates, vec![group], sensors.collect(), options)
    }

    /// The plan that trains `candidates` on `sensors`, each in the environments of its group. Runs are known by the settings of
    /// `candidates`, whatever the discount factor of the group.
    pub fn of_groups(
        candidates: &'a [Candidate],
        groups: Vec<SensorGroup<'a>>,
        sensors: Vec<PlannedSensor>,
        options: PlanOptions,
    ) -> Self {
        Self {
            candidates,
            settings: OnceLock::new(),
            groups,
            sensors,
            starts: BTreeMap::new(),
            baselines: None,
            program: None,
            accelerator: None,
            options,
            work_between: WORK_BETWEEN,
            races: None,
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

    /// The same plan as a race: after each round the worse half of the values is dropped, and a sensor makes no more runs once one value
    /// is left. Online always trains all values. Every run that is made is the one that it would be without the race.
    ///
    /// The first round has ⌈N / 2^⌈log₂ V⌉⌉ of N streams, at least two, and each one after it as many as all before. After them ⌈V/2⌉,
    /// ⌈V/4⌉, … of V values are left, so that about half of all streams are ever seen, by few values. Streams come in turn from members and
    /// log, as many as there are of each. What leads is the value that diverged in the fewest streams so far, and of these has the smallest
    /// mean logarithm of the error over the others.
    ///
    /// Source: successive halving (Karnin, Koren & Somekh 2013; Jamieson & Talwalkar 2016), with streams as its resource.
    #[must_use]
    pub fn race(mut self) -> Self {
        let races = self.groups.iter().map(|group| {
            Race::new(&group.raced_streams(), self.candidates.len(), self.options.part)
        });
        self.races = Some(races.collect());
        self
    }

    /// Units in all, as many as there can be.
    pub fn count(&self) -> usize {
        let runs: Vec<usize> = self.groups.iter().map(SensorGroup::runs).collect();
        self.sensors.iter().map(|sensor| runs[sensor.group]).sum()
    }

    /// Units whose values are known before any has been run, which are all units but in a race: sensor by sensor, environment by
    /// environment, run by run.
    pub fn units(&self) -> Vec<PlannedUnit> {
        self.jobs(&Survivors::default()).iter().map(UnitJob::planned).collect()
    }

    /// All units there can be, as they are where nothing is dropped before them.
    pub fn every_unit(&self) -> Vec<PlannedUnit> {
        let jobs = self.jobs_after(None, &|_| true);
        jobs.iter().map(UnitJob::planned).collect()
    }

    /// The runs of a result, each under the key of its setting.
    pub fn runs_of(&self, result: &UnitResult) -> UnitRuns {
        let settings = self.settings();
        let UnitResult { key, unit, seed, start_row, not_finite, rows } = result;
        UnitRuns {
            key: key.clone(),
            unit: unit.clone(),
            seed: *seed,
            start_row: *start_row,
            not_finite: *not_finite,
            runs: rows
                .iter()
                .map(|row| (settings[row.candidate].to_string(), row.into()))
                .collect(),
        }
    }

    /// The results as they are planned, with which candidates a race left in each.
    pub fn planned(&self, results: &[UnitResult]) -> Vec<PlannedUnit> {
        results
            .iter()
            .map(|UnitResult { unit, key, rows, .. }| {
                let trained: BTreeSet<usize> = rows.iter().map(|row| row.candidate).collect();
                let dropped = (0..self.candidates.len())
                    .filter(|candidate| !trained.contains(candidate))
                    .collect();
                PlannedUnit { unit: unit.clone(), key: key.clone(), dropped }
            })
            .collect()
    }

    /// The results that `store` has.
    pub fn stored(&self, store: &UnitStore) -> StoredUnits {
        self.known(&|unit, key| store.get(unit, key))
    }

    /// The results that `look_up` finds by unit and key.
    pub fn known(&self, look_up: Lookup<'_>) -> StoredUnits {
        let mut found = StoredUnits::default();
        let mut survivors = Survivors::default();
        loop {
            found.read(&self.jobs(&survivors), look_up);
            if !self.decide(&mut survivors, &found.whole) {
                return found;
            }
        }
    }

    /// Units of which something has to be run beside `found`; in a race, at most.
    pub fn left(&self, found: &StoredUnits) -> usize {
        self.missing(&found.whole).len()
    }

    /// Runs that have to be made beside `found`, one for each setting of a unit; in a race, at most.
    pub fn runs_left(&self, found: &StoredUnits) -> usize {
        let mut survivors = Survivors::default();
        self.decide(&mut survivors, &found.whole);
        let known = self.jobs(&survivors);
        let known: BTreeMap<&Unit, usize> = known
            .iter()
            .filter_map(|job| Some((&job.unit, found.rest(job)?.agents.len())))
            .collect();
        let missing = self.missing(&found.whole);
        missing.iter().map(|unit| *known.get(unit).unwrap_or(&self.candidates.len())).sum()
    }

    /// Units that have to be run beside `found`; in a race, at most.
    fn missing(&self, found: &BTreeMap<Unit, UnitResult>) -> Vec<Unit> {
        let mut survivors = Survivors::default();
        self.decide(&mut survivors, found);
        let mut missing = Vec::new();
        for PlannedSensor { name, group, .. } in &self.sensors {
            for environment in &self.groups[*group].environments {
                for run in 0..environment.runs() {
                    let unit = Unit { sensor: name.clone(), environment: environment.id(), run };
                    if !self.is_spared(&unit, &survivors) && !found.contains_key(&unit) {
                        missing.push(unit);
                    }
                }
            }
        }
        missing
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

    /// Run what units have no run of in `stored`, in parallel, put their results in `store`, and return
    /// all results in the order of [`units`](Self::units). Results do not depend on the number of threads.
    ///
    /// The units of one run in one environment share a pass over its stream, whatever sensor of a group they predict.
    /// Long passes keep their state in the store, so that a killed one goes on in the middle.
    ///
    /// # Errors
    /// The first failure, or [`SweepError::Cancelled`]; finished units stay stored.
    pub fn complete(
        &self,
        stored: StoredUnits,
        store: &UnitStore,
        monitor: &dyn Monitor,
    ) -> Result<CompletedSweep, SweepError> {
        let mut found = stored;
        let mut ran = 0;
        let mut runs = 0;
        let kept = store.states_kept();
        let mut left = self.passes(&found);
        monitor.begin("training", (left * self.options.span.steps) as u64);
        let mut survivors = Survivors::default();
        loop {
            let jobs = self.jobs(&survivors);
            // Values of later runs were not known before: what is stored of them is not run again, and some are not needed.
            found.read(&jobs, &|unit, key| store.get(unit, key));
            let now = self.passes(&found);
            // Sensors need not have come equally far before, so that one pass can train units of several rounds.
            let done = left.saturating_sub(now);
            monitor.advance((done * self.options.span.steps) as u64);
            let rest: Vec<UnitJob<'_>> = jobs.iter().filter_map(|job| found.rest(job)).collect();
            let trained = self.train(&rest, store, monitor)?;
            ran += trained.len();
            runs += trained.iter().map(|made| made.runs.len()).sum::<usize>();
            left = now.saturating_sub(self.passes_of(&trained));
            let mut trained: BTreeMap<Unit, UnitRuns> =
                trained.into_iter().map(|made| (made.unit.clone(), made)).collect();
            for job in &jobs {
                if let Some(made) = trained.remove(&job.unit) {
                    found.add(job, made);
                }
            }
            if !self.decide(&mut survivors, &found.whole) {
                store.forget_stale(&kept);
                let results = jobs.iter().filter_map(|job| found.whole.remove(&job.unit)).collect();
                return Ok(CompletedSweep { results, ran, runs });
            }
        }
    }

    /// Passes over streams that are still to be made beside `found`, in a race at most: sensors share those of a run.
    pub fn passes(&self, found: &StoredUnits) -> usize {
        self.passes_over(self.missing(&found.whole).iter())
    }

    fn passes_of(&self, made: &[UnitRuns]) -> usize {
        self.passes_over(made.iter().map(|made| &made.unit))
    }

    fn passes_over<'u>(&self, units: impl Iterator<Item = &'u Unit>) -> usize {
        let passes = units.map(|unit| (self.group_of(&unit.sensor), unit.environment, unit.run));
        passes.collect::<BTreeSet<_>>().len()
    }

    /// Position of a sensor's group; the first of a sensor that the plan does not have.
    fn group_of(&self, sensor: &str) -> usize {
        self.sensors.iter().find(|planned| planned.name == sensor).map_or(0, |found| found.group)
    }

    /// Run these jobs, in parallel.
    fn train(
        &self,
        jobs: &[UnitJob<'_>],
        store: &UnitStore,
        monitor: &dyn Monitor,
    ) -> Result<Vec<UnitRuns>, SweepError> {
        let mut missing: BTreeMap<(usize, EnvironmentId, usize), Vec<&UnitJob<'_>>> =
            BTreeMap::new();
        for job in jobs {
            let pass = (job.group, job.unit.environment, job.unit.run);
            missing.entry(pass).or_default().push(job);
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
    fn pass<'p>(&'p self, jobs: Vec<&'p UnitJob<'a>>) -> Pass<'p, 'a> {
        Pass {
            jobs,
            program: self.program,
            baselines: self.baselines,
            options: &self.options,
            work_between: self.work_between,
        }
    }

    /// Decide what the results allow to decide; whether that was anything.
    fn decide(&self, survivors: &mut Survivors, found: &BTreeMap<Unit, UnitResult>) -> bool {
        let Some(races) = &self.races else { return false };
        let mut decided = false;
        for PlannedSensor { name, group, .. } in &self.sensors {
            let after = races[*group].survivors(name, found);
            decided |= after.len() > survivors.rounds(name).len();
            survivors.0.insert(name.clone(), after);
        }
        decided
    }

    /// The round of the race before that of a unit; none if it is made whatever happens.
    fn round_before(&self, unit: &Unit) -> Option<usize> {
        let race = &self.races.as_ref()?[self.group_of(&unit.sensor)];
        race.round(unit.environment, unit.run)?.checked_sub(1)
    }

    /// The values that are left before the round of a unit.
    fn left_before<'s>(&self, unit: &Unit, survivors: &'s Survivors) -> SurvivorsBefore<'s> {
        let Some(round) = self.round_before(unit) else { return SurvivorsBefore::All };
        if self.is_spared(unit, survivors) {
            return SurvivorsBefore::One;
        }
        survivors
            .rounds(&unit.sensor)
            .get(round)
            .map_or(SurvivorsBefore::NotKnown, SurvivorsBefore::Some)
    }

    /// Whether one value is left before the round of a unit.
    fn is_spared(&self, unit: &Unit, survivors: &Survivors) -> bool {
        let rounds = survivors.rounds(&unit.sensor);
        self.round_before(unit)
            .is_some_and(|round: usize| rounds.iter().take(round + 1).any(|left| left.len() < 2))
    }

    /// The units whose values are known when `survivors` are.
    fn jobs(&self, survivors: &Survivors) -> Vec<UnitJob<'_>> {
        self.jobs_of(survivors, &|_| true)
    }

    /// Those of them that are `wanted`.
    fn jobs_of(&self, survivors: &Survivors, wanted: &dyn Fn(&Unit) -> bool) -> Vec<UnitJob<'_>> {
        self.jobs_after(Some(survivors), wanted)
    }

    /// The same, or all as if nothing were ever dropped.
    fn jobs_after(
        &self,
        survivors: Option<&Survivors>,
        wanted: &dyn Fn(&Unit) -> bool,
    ) -> Vec<UnitJob<'_>> {
        let mut jobs = Vec::new();
        for &PlannedSensor { ref name, column, group } in &self.sensors {
            let SensorGroup { candidates, environments, .. } = &self.groups[group];
            for &environment in environments {
                for run in 0..environment.runs() {
                    let unit = Unit { sensor: name.clone(), environment: environment.id(), run };
                    if !wanted(&unit) {
                        continue;
                    }
                    let left = match survivors {
                        Some(survivors) => match self.left_before(&unit, survivors) {
                            SurvivorsBefore::All => None,
                            SurvivorsBefore::Some(left) => Some(left),
                            SurvivorsBefore::One | SurvivorsBefore::NotKnown => continue,
                        },
                        None => None,
                    };
                    let is_left = |index: &usize| {
                        left.is_none_or(|left: &BTreeSet<usize>| left.contains(index))
                    };
                    let all = 0..self.candidates.len();
                    let trained: Vec<usize> = all.clone().filter(is_left).collect();
                    let dropped = all.filter(|index| !is_left(index)).collect();
                    let agents: Vec<&Candidate> =
                        trained.iter().map(|&index| &candidates[index]).collect();
                    let settings =
                        trained.iter().map(|&index| Arc::clone(&self.settings()[index])).collect();
                    let seed =
                        self.options.seed.child(&environment.id().to_string()).number(run as u64);
                    let start = self.starts.get(name);
                    let inputs = UnitInputs {
                        group: &self.groups[group],
                        column,
                        agents: &agents,
                        start,
                        seed,
                        stream: &environment.inputs(run),
                    };
                    let key = self.key(&unit, &inputs);
                    jobs.push(UnitJob {
                        unit,
                        group,
                        environment,
                        column,
                        agents,
                        settings,
                        dropped,
                        start,
                        seed,
                        key,
                    });
                }
            }
        }
        jobs
    }
}
