//! Parts of a plan that are run apart, by other processes on other machines.

use std::collections::{BTreeMap, BTreeSet};

use calib_core::Monitor;
use serde::{Deserialize, Serialize};

use super::{Lookup, Plan, StoredUnits, Survivors, UnitJob};
use crate::{
    EnvironmentId, PlannedUnit, SweepError, Unit, UnitResult, UnitRuns, UnitSink, cohorts,
};

/// The units of some sensors of a group in one run of one environment, which share a pass over its stream.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct PassId {
    /// Where the stream comes from.
    pub environment: EnvironmentId,
    /// Number of the run.
    pub run: usize,
    /// Names of the sensors.
    pub sensors: BTreeSet<String>,
}

impl PassId {
    /// Whether a unit is one of its.
    pub fn has(&self, unit: &Unit) -> bool {
        (unit.environment, unit.run) == (self.environment, self.run)
            && self.sensors.contains(&unit.sensor)
    }

    /// Its units.
    pub fn units(&self) -> impl Iterator<Item = Unit> + '_ {
        let Self { environment, run, sensors } = self;
        sensors.iter().map(|sensor| Unit {
            sensor: sensor.clone(),
            environment: *environment,
            run: *run,
        })
    }
}

/// A pass whose values are known, as far as it has no results.
pub struct ReadyPass<'p> {
    jobs: Vec<UnitJob<'p>>,
}

impl<'p> ReadyPass<'p> {
    /// What is to be trained of it beside the runs that `look_up` finds.
    fn rest(&self, look_up: Lookup<'_>) -> Vec<UnitJob<'p>> {
        let mut stored = StoredUnits::default();
        stored.read(&self.jobs, look_up);
        self.jobs.iter().filter_map(|job| stored.rest(job)).collect()
    }

    /// Its units, each with the fingerprint of what it follows from.
    pub fn units(&self) -> impl Iterator<Item = PlannedUnit> + '_ {
        self.jobs.iter().map(UnitJob::planned)
    }

    /// Whether `look_up` finds every run of it.
    pub fn is_found(&self, look_up: Lookup<'_>) -> bool {
        self.rest(look_up).is_empty()
    }
}

impl Plan<'_> {
    /// In which stage a pass can be made: results of all stages before decide its values. Without a race there is one.
    pub fn stage(&self, pass: &PassId) -> usize {
        let group = pass.sensors.first().map_or(0, |sensor| self.group_of(sensor));
        let race = self.races.as_ref().map(|races| &races[group]);
        race.and_then(|race| race.round(pass.environment, pass.run)).unwrap_or(0)
    }

    /// The units of `passes` that are to be made where `before` are the results of all stages before; of a race, those
    /// that are not spared.
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

    /// Check that nothing has to be run beside `found`.
    ///
    /// # Errors
    /// [`SweepError::Incomplete`].
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

    /// Train what `look_up` does not find of a pass, and put the runs into `sink`: the same as in the whole plan. A pass that is interrupted keeps its state in the sink, and goes on from it.
    ///
    /// # Errors
    /// As [`complete`](Self::complete).
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
