//! Stored results of a plan, and the runs that are still missing.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

use calib_core::Seed;
use rayon::prelude::*;

use crate::{Candidate, Environment, PlannedUnit, Start, Unit, UnitResult, UnitRuns};

/// A function that finds the runs of a unit by unit and key.
pub(super) type Lookup<'l> = &'l (dyn Fn(&Unit, &str) -> Option<UnitRuns> + Sync);

/// The stored results of a plan.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StoredUnits {
    /// Units that have a run of every setting.
    pub(super) whole: BTreeMap<Unit, UnitResult>,
    /// The runs of incomplete units. A smaller grid may have left them.
    begun: BTreeMap<Unit, UnitRuns>,
}

impl StoredUnits {
    /// Returns the results of the complete units.
    pub fn whole(&self) -> &BTreeMap<Unit, UnitResult> {
        &self.whole
    }

    /// Returns the runs of the incomplete units.
    pub fn begun(&self) -> &BTreeMap<Unit, UnitRuns> {
        &self.begun
    }

    /// Adds the results that `look_up` finds for `jobs`.
    pub(super) fn read(&mut self, jobs: &[UnitJob<'_>], look_up: Lookup<'_>) {
        let read: Vec<(&UnitJob<'_>, UnitRuns)> = jobs
            .par_iter()
            .filter(|job| !self.whole.contains_key(&job.unit))
            .filter_map(|job| Some((job, look_up(&job.unit, &job.key)?)))
            .collect();
        for (job, mut runs) in read {
            let own: BTreeSet<&str> = job.settings.iter().map(|setting| &**setting).collect();
            runs.runs.retain(|setting, _| own.contains(setting.as_str()));
            self.add(job, runs);
        }
    }

    /// Adds runs of a job. They may complete its unit.
    pub(super) fn add(&mut self, job: &UnitJob<'_>, runs: UnitRuns) {
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

    /// Returns the part of a job that lacks runs, if any.
    pub(super) fn rest<'a>(&self, job: &UnitJob<'a>) -> Option<UnitJob<'a>> {
        if self.whole.contains_key(&job.unit) {
            return None;
        }
        let begun = self.begun.get(&job.unit);
        Some(job.of(|setting| begun.is_none_or(|begun| !begun.runs.contains_key(setting))))
    }
}

/// A unit and the data needed to train it.
#[derive(Clone)]
pub(crate) struct UnitJob<'a> {
    pub(crate) unit: Unit,
    /// Position of the sensor's group. Units of one group share passes.
    pub(super) group: usize,
    pub(crate) environment: &'a dyn Environment,
    pub(crate) column: usize,
    pub(crate) agents: Vec<&'a Candidate>,
    /// The key of each agent's setting.
    pub(crate) settings: Vec<Arc<str>>,
    /// Positions of the settings that were dropped before.
    pub(crate) dropped: BTreeSet<usize>,
    pub(crate) start: Option<&'a Start>,
    pub(crate) seed: Seed,
    /// Fingerprint of all inputs of its runs except their settings.
    pub(crate) key: String,
}

impl UnitJob<'_> {
    /// Returns the position and key of each trained setting.
    fn trained(&self) -> impl Iterator<Item = (usize, &str)> {
        let settings = self.settings.iter().map(AsRef::as_ref);
        self.agents.iter().map(|agent| agent.index).zip(settings)
    }

    /// Returns the planned unit of the job.
    pub(super) fn planned(&self) -> PlannedUnit {
        let Self { unit, key, dropped, .. } = self.clone();
        PlannedUnit { unit, key, dropped }
    }

    /// Returns the same job with only the agents whose settings are `wanted`.
    fn of(&self, wanted: impl Fn(&str) -> bool) -> Self {
        let both = self.agents.iter().zip(&self.settings).filter(|(_, setting)| wanted(setting));
        let (agents, settings) = both.map(|(agent, setting)| (*agent, Arc::clone(setting))).unzip();
        Self { agents, settings, ..self.clone() }
    }
}
