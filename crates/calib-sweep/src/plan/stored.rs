//! What there is of the results of a plan, and what is left to be trained.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

use calib_core::Seed;
use rayon::prelude::*;

use crate::{Candidate, Environment, PlannedUnit, Start, Unit, UnitResult, UnitRuns};

/// What looks the runs of a unit up by unit and key.
pub(super) type Lookup<'l> = &'l (dyn Fn(&Unit, &str) -> Option<UnitRuns> + Sync);

/// What is there of the results of a plan.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StoredUnits {
    /// Units that have a run of every setting.
    pub(super) whole: BTreeMap<Unit, UnitResult>,
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
    pub(super) fn read(&mut self, jobs: &[UnitJob<'_>], look_up: Lookup<'_>) {
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

    /// What is left to be trained of a job, if anything is.
    pub(super) fn rest<'a>(&self, job: &UnitJob<'a>) -> Option<UnitJob<'a>> {
        if self.whole.contains_key(&job.unit) {
            return None;
        }
        let begun = self.begun.get(&job.unit);
        Some(job.of(|setting| begun.is_none_or(|begun| !begun.runs.contains_key(setting))))
    }
}

/// A unit with what is needed to run it.
#[derive(Clone)]
pub(crate) struct UnitJob<'a> {
    pub(crate) unit: Unit,
    /// Position of the sensor's group: units of one group share passes.
    pub(super) group: usize,
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
    pub(super) fn planned(&self) -> PlannedUnit {
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
