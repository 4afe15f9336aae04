//! Parts of a plan that other processes on other machines can run.

use std::collections::{BTreeMap, BTreeSet};

use calib_core::Monitor;
use serde::{Deserialize, Serialize};

use super::{Lookup, Plan, StoredUnits, Survivors, UnitJob};
use crate::{
    EnvironmentId, PlannedUnit, SweepError, Unit, UnitResult, UnitRuns, UnitSink, cohorts,
};

/// The identity of a pass: some sensors of a group in one run of one environment. Their units share the pass.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct PassId {
    /// The environment of the stream.
    pub environment: EnvironmentId,
    /// Number of the run.
    pub run: usize,
    /// Names of the sensors.
    pub sensors: BTreeSet<String>,
}

impl PassId {
    /// Whether `unit` belongs to the pass.
    pub fn has(&self, unit: &Unit) -> bool {
        (unit.environment, unit.run) == (self.environment, self.run)
            && self.sensors.contains(&unit.sensor)
    }

    /// Returns the units of the pass.
    pub fn units(&self) -> impl Iterator<Item = Unit> + '_ {
        let Self { environment, run, sensors } = self;
        sensors.iter().map(|sensor| Unit {
            sensor: sensor.clone(),
            environment: *environment,
            run: *run,
        })
    }
}

/// A pass whose settings are known, with the units that need training.
pub struct ReadyPass<'p> {
    jobs: Vec<UnitJob<'p>>,
}

impl<'p> ReadyPass<'p> {
    /// Returns the jobs with the runs that `look_up` does not find.
    fn rest(&self, look_up: Lookup<'_>) -> Vec<UnitJob<'p>> {
        let mut stored = StoredUnits::default();
        stored.read(&self.jobs, look_up);
        self.jobs.iter().filter_map(|job| stored.rest(job)).collect()
    }

    /// Returns the units of the pass, each with the fingerprint of its inputs.
    pub fn units(&self) -> impl Iterator<Item = PlannedUnit> + '_ {
        self.jobs.iter().map(UnitJob::planned)
    }

    /// Whether `look_up` finds every run of the pass.
    pub fn is_found(&self, look_up: Lookup<'_>) -> bool {
        self.rest(look_up).is_empty()
    }
}

impl Plan<'_> {
    /// Returns the stage in which a pass can run. Its settings depend on the results of all earlier stages. Without a
    /// race there is one stage.
    pub fn stage(&self, pass: &PassId) -> usize {
        let group = pass.sensors.first().map_or(0, |sensor| self.group_of(sensor));
        let race = self.races.as_ref().map(|races| &races[group]);
        race.and_then(|race| race.round(pass.environment, pass.run)).unwrap_or(0)
    }

    /// Returns the `passes` to run, given `before`, the results of all earlier stages. In a race, units that are no
    /// longer needed are left out.
    pub fn ready<'p>(
        &'p self,
        passes: &[PassId],
        before: &BTreeMap<Unit, UnitResult>,
    ) -> Vec<ReadyPass<'p>> {
        let mut survivors = Survivors::default();
        self.decide(&mut survivors, before);
        let pass_of: BTreeMap<Unit, usize> = passes
            .iter()
            .enumerate()
            .flat_map(|(number, pass)| pass.units().map(move |unit| (unit, number)))
            .collect();
        let mut ready: Vec<ReadyPass<'p>> =
            passes.iter().map(|_| ReadyPass { jobs: Vec::new() }).collect();
        for job in self.jobs_after(Some(&survivors), &|unit| pass_of.contains_key(unit)) {
            ready[pass_of[&job.unit]].jobs.push(job);
        }
        ready
    }

    /// Checks that `found` lacks no run.
    ///
    /// # Errors
    /// Returns [`SweepError::Incomplete`] if it does.
    pub fn collected(&self, found: &StoredUnits) -> Result<(), SweepError> {
        let missing = self.missing(found.whole());
        match missing.first() {
            Some(example) => Err(SweepError::Incomplete {
                missing: missing.len(),
                planned: self.count(),
                example: example.clone(),
            }),
            None => Ok(()),
        }
    }

    /// Trains the runs of a pass that `look_up` does not find, and puts them into `sink`. They are the same as in the
    /// whole plan. An interrupted pass keeps its state in the sink and resumes from it.
    ///
    /// # Errors
    /// Fails as [`complete`](Self::complete) does.
    pub fn train_ready(
        &self,
        ready: &ReadyPass<'_>,
        look_up: Lookup<'_>,
        sink: &dyn UnitSink,
        monitor: &dyn Monitor,
    ) -> Result<Vec<UnitRuns>, SweepError> {
        let rest = ready.rest(look_up);
        if rest.is_empty() {
            return Ok(Vec::new());
        }
        monitor.check()?;
        let pass = self.pass(rest.iter().collect());
        match self.accelerator {
            Some(accelerator) => cohorts::run(&[pass], accelerator, sink, monitor),
            None => pass.run(sink, monitor),
        }
    }
}
