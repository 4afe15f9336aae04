use std::{
    collections::{BTreeMap, BTreeSet},
    sync::{Arc, OnceLock},
};

use calib_agent::Accelerator;

use crate::{
    Baselines, Candidate, Environment, PlannedUnit, Program, Start, Unit, UnitResult, UnitRuns,
    UnitStore, WORK_BETWEEN, race::Race,
};

mod group;
mod key;
mod options;
mod part;
mod rounds;
mod stored;
mod survivors;
mod training;
mod unit_inputs;

pub use group::{PlannedSensor, SensorGroup};
pub use options::PlanOptions;
pub use part::{PassId, ReadyPass};
use stored::Lookup;
pub use stored::StoredUnits;
pub(crate) use stored::UnitJob;
use survivors::{Survivors, SurvivorsBefore};
pub use training::CompletedSweep;
use unit_inputs::UnitInputs;

/// Version of the results. Raise it whenever the same inputs give other bytes, so that results of different versions of
/// calib are never compared.
pub const RESULT_VERSION: u32 = 4;

/// All units of a sweep, in a fixed order.
pub struct Plan<'a> {
    candidates: &'a [Candidate],
    /// The keys of the settings, computed on first use.
    settings: OnceLock<Vec<Arc<str>>>,
    groups: Vec<SensorGroup<'a>>,
    sensors: Vec<PlannedSensor>,
    /// The checkpoint that the agents of each pre-trained sensor start from.
    starts: BTreeMap<String, Start>,
    /// The log that the baselines of agents are fitted on.
    baselines: Option<&'a Baselines<'a>>,
    /// The external program that trains agents, if any.
    program: Option<&'a dyn Program>,
    /// The accelerator that computes matrix products, if any.
    accelerator: Option<&'a dyn Accelerator>,
    options: PlanOptions,
    work_between: u64,
    /// The race of each group, if the plan is a race.
    races: Option<Vec<Race>>,
}

impl<'a> Plan<'a> {
    /// Creates the plan that trains `candidates` on `sensors` (name and column) in `environments`.
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

    /// Creates the plan that trains `candidates` on `sensors`, each in the environments of its group. Run keys come
    /// from `candidates`, whatever the discount factor of the group.
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

    /// Uses the agents of `program`, if there is one.
    #[must_use]
    pub fn with_program(mut self, program: Option<&'a dyn Program>) -> Self {
        self.program = program;
        self
    }

    /// Trains passes side by side on `accelerator`, if there is one. Results differ from those of a plan without it.
    #[must_use]
    pub fn with_accelerator(mut self, accelerator: Option<&'a dyn Accelerator>) -> Self {
        self.accelerator = accelerator;
        self
    }

    /// Starts agents from checkpoints, one per sensor.
    #[must_use]
    pub fn starting_from(mut self, starts: BTreeMap<String, Start>) -> Self {
        self.starts = starts;
        self
    }

    /// Fits the baselines of agents on a log.
    #[must_use]
    pub fn with_baselines(mut self, baselines: Option<&'a Baselines<'a>>) -> Self {
        self.baselines = baselines;
        self
    }

    /// Saves the state of long runs after this much work instead of [`WORK_BETWEEN`]. Results do not depend on it.
    #[must_use]
    pub fn keeping_after(mut self, work_between: u64) -> Self {
        self.work_between = work_between;
        self
    }

    /// Turns the plan into a race. After each round the worse half of the settings is dropped. A sensor makes no more
    /// runs once one setting is left. Online always trains all settings. Each run is the same as it would be without
    /// the race.
    ///
    /// The first round has ⌈N / 2^⌈log₂ V⌉⌉ of N streams, and at least two. Each later round has as many streams as all
    /// rounds before it. After the rounds ⌈V/2⌉, ⌈V/4⌉, … of V settings are left. So only about half of all streams are
    /// ever used, the later ones by few settings. Streams come in turn from members and log, in proportion to their
    /// numbers. Settings are ranked by the number of streams in which they diverged, and then by the mean logarithm of
    /// the error over the other streams.
    ///
    /// Source: successive halving (Karnin, Koren & Somekh 2013; Jamieson & Talwalkar 2016), with streams as its
    /// resource.
    #[must_use]
    pub fn race(mut self) -> Self {
        let races = self.groups.iter().map(|group| {
            Race::new(&group.raced_streams(), self.candidates.len(), self.options.part)
        });
        self.races = Some(races.collect());
        self
    }

    /// Returns the largest possible number of units.
    pub fn count(&self) -> usize {
        let runs: Vec<usize> = self.groups.iter().map(SensorGroup::runs).collect();
        self.sensors.iter().map(|sensor| runs[sensor.group]).sum()
    }

    /// Returns the units whose settings are known before any run. Without a race these are all units. They are ordered
    /// by sensor, environment and run.
    pub fn units(&self) -> Vec<PlannedUnit> {
        self.jobs(&Survivors::default()).iter().map(UnitJob::planned).collect()
    }

    /// Returns all possible units, as if no setting were dropped.
    pub fn every_unit(&self) -> Vec<PlannedUnit> {
        let jobs = self.jobs_after(None, &|_| true);
        jobs.iter().map(UnitJob::planned).collect()
    }

    /// Returns the runs of a result, each under the key of its setting.
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

    /// Returns the planned units of the results, with the settings that a race dropped before each.
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

    /// Returns the results that `store` holds.
    pub fn stored(&self, store: &UnitStore) -> StoredUnits {
        self.known(&|unit, key| store.get(unit, key))
    }

    /// Returns the results that `look_up` finds by unit and key.
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

    /// Returns the number of units that lack a run in `found`. In a race it is an upper bound.
    pub fn left(&self, found: &StoredUnits) -> usize {
        self.missing(&found.whole).len()
    }

    /// Returns the number of runs that `found` lacks, counting one per setting of a unit. In a race it is an upper
    /// bound.
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

    /// Returns the units that lack a run in `found`. In a race some of them may not be needed.
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

    /// Returns the position of a sensor's group, or of the first group if the plan does not have the sensor.
    fn group_of(&self, sensor: &str) -> usize {
        self.sensors.iter().find(|planned| planned.name == sensor).map_or(0, |found| found.group)
    }

    /// Returns the jobs whose settings are known once `survivors` are.
    fn jobs(&self, survivors: &Survivors) -> Vec<UnitJob<'_>> {
        self.jobs_after(Some(survivors), &|_| true)
    }

    /// Returns the `wanted` jobs. Without `survivors` no setting counts as dropped.
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
                    let left = match survivors.map(|survivors| self.left_before(&unit, survivors)) {
                        None | Some(SurvivorsBefore::All) => None,
                        Some(SurvivorsBefore::Some(left)) => Some(left),
                        Some(SurvivorsBefore::OneOrUnknown) => continue,
                    };
                    let (trained, dropped): (Vec<usize>, Vec<usize>) = (0..self.candidates.len())
                        .partition(|index| {
                            left.is_none_or(|left: &BTreeSet<usize>| left.contains(index))
                        });
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
                        dropped: dropped.into_iter().collect(),
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
