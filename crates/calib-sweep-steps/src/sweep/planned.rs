//! `planned.json` of a sweep: the keys of its runs, so that they can be read while the sweep runs.

use std::path::Path;

use calib_agent::Part;
use calib_base::StepError;
use calib_files::{read_sealed_json, write_sealed_json};
use calib_study::Study;
use calib_sweep::{Candidate, EnvironmentId, Plan, PlannedUnit, Rule, Unit, UnitRuns};
use serde::{Deserialize, Serialize};

use super::unit_store::unit_store;

const FILE: &str = "planned.json";
const FORMAT: u32 = 1;

/// The settings and units of a sweep.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub struct PlannedSweep {
    format: u32,
    /// The arithmetic that trains the agents, if it is not calib's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    arithmetic: Option<String>,
    /// The study of a sweep that was begun. A cluster plan stores it elsewhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    study: Option<Study>,
    /// The part of each run that counts.
    pub(crate) part: Part,
    pub(crate) rule: Rule,
    /// The label of each setting.
    pub labels: Vec<String>,
    /// Position of the default setting.
    pub default: Option<usize>,
    /// The key of each setting.
    settings: Vec<String>,
    units: Vec<PlannedUnit>,
}

/// A stored run of a setting.
pub struct StoredRun<'p> {
    /// The number of its unit in the plan. Runs with the same number are on the same stream.
    pub unit: usize,
    place: &'p Unit,
    /// Position of its setting.
    pub candidate: usize,
    /// Its error in normalised units. Infinite if it diverged.
    pub rmse: f64,
}

impl StoredRun<'_> {
    /// Returns the predicted sensor.
    pub fn sensor(&self) -> &str {
        &self.place.sensor
    }

    /// Returns the environment of the run.
    pub fn environment(&self) -> EnvironmentId {
        self.place.environment
    }
}

impl PlannedSweep {
    /// Returns the settings and units of this plan. `arithmetic` names the arithmetic that trains the
    /// agents, if it is not calib's own.
    pub fn of(
        study: &Study,
        candidates: &[Candidate],
        plan: &Plan<'_>,
        arithmetic: Option<&str>,
    ) -> Self {
        Self {
            format: FORMAT,
            arithmetic: arithmetic.map(str::to_owned),
            study: None,
            part: study.part(),
            rule: study.evaluate.rule,
            labels: candidates.iter().map(Candidate::label).collect(),
            default: candidates.iter().position(|candidate| candidate.is_default),
            settings: plan.settings().iter().map(ToString::to_string).collect(),
            units: plan.every_unit(),
        }
    }

    /// Adds the study of a sweep that begins.
    pub(crate) fn begun_for(self, study: &Study) -> Self {
        Self { study: Some(study.clone()), ..self }
    }

    /// Returns the study that the sweep was begun for. `None` if an earlier calib began it.
    pub fn study(&self) -> Option<&Study> {
        self.study.as_ref()
    }

    /// # Errors
    /// Returns an error if the file cannot be written.
    pub(crate) fn write(&self, directory: &Path) -> Result<(), StepError> {
        Ok(write_sealed_json(&directory.join(FILE), self)?)
    }

    /// Reads the file of the sweep in `directory`, if it was begun.
    pub fn read(directory: &Path) -> Option<Self> {
        let planned: Self = read_sealed_json(&directory.join(FILE)).ok()?;
        (planned.format == FORMAT).then_some(planned)
    }

    /// Returns the sensors, in order.
    pub fn sensors(&self) -> Vec<&str> {
        let mut sensors: Vec<&str> =
            self.units.iter().map(|planned| planned.unit.sensor.as_str()).collect();
        sensors.dedup();
        sensors
    }

    /// Returns the number of all runs of a sensor. In a race it is an upper bound.
    pub fn runs_of(&self, sensor: &str) -> usize {
        let units = self.units.iter().filter(|planned| planned.unit.sensor == sensor);
        units.count() * self.settings.len()
    }

    /// Returns the stored runs of the sweep in `directory`.
    pub fn stored_in(&self, directory: &Path) -> Vec<StoredRun<'_>> {
        let store = unit_store(directory, self.arithmetic.as_deref());
        self.stored(&|unit, key| store.get(unit, key))
    }

    /// Returns the runs that `look_up` finds by unit and key.
    pub fn stored(&self, look_up: &dyn Fn(&Unit, &str) -> Option<UnitRuns>) -> Vec<StoredRun<'_>> {
        let mut all = Vec::new();
        for (number, planned) in self.units.iter().enumerate() {
            let Some(runs) = look_up(&planned.unit, &planned.key) else { continue };
            for row in runs.of(planned, &self.settings) {
                if let Some(rmse) = row.rmse(self.part) {
                    all.push(StoredRun {
                        unit: number,
                        place: &planned.unit,
                        candidate: row.candidate,
                        rmse,
                    });
                }
            }
        }
        all
    }

    /// Whether the rule uses runs in this environment.
    pub fn counts(&self, environment: EnvironmentId) -> bool {
        match environment {
            EnvironmentId::Online => false,
            EnvironmentId::LogReplay => {
                matches!(self.rule, Rule::Pooled | Rule::LogReplay | Rule::OneStandardError)
            }
            EnvironmentId::Member(_) => self.rule != Rule::LogReplay || !self.replays_the_log(),
        }
    }

    /// Returns the environments of the plan that the rule uses, once for each of their units.
    pub fn environments_that_count(&self) -> Vec<EnvironmentId> {
        let all = self.units.iter().map(|planned| planned.unit.environment);
        all.filter(|environment| self.counts(*environment)).collect()
    }

    fn replays_the_log(&self) -> bool {
        self.units.iter().any(|planned| planned.unit.environment == EnvironmentId::LogReplay)
    }
}
