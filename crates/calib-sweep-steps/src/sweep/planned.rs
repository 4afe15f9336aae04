//! `planned.json` of a sweep: what its runs are known by, so that they can be looked at while they are made.

use std::path::Path;

use calib_agent::Part;
use calib_base::StepError;
use calib_files::{read_sealed_json, write_sealed_json};
use calib_study::Study;
use calib_sweep::{Candidate, EnvironmentId, Plan, PlannedUnit, Rule, Unit, UnitRuns};
use serde::{Deserialize, Serialize};

use super::unit_store;

const FILE: &str = "planned.json";
const FORMAT: u32 = 1;

/// The settings and units of a sweep.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub struct PlannedSweep {
    format: u32,
    /// Of what the agents are trained with, if not calib's own arithmetic.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    arithmetic: Option<String>,
    /// The study of a sweep that was begun. A plan for a cluster has it elsewhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    study: Option<Study>,
    /// The part of each run that counts.
    pub(crate) part: Part,
    pub(crate) rule: Rule,
    /// What each candidate is called.
    pub labels: Vec<String>,
    /// The candidate that is the default.
    pub default: Option<usize>,
    /// The key of each candidate's setting.
    settings: Vec<String>,
    units: Vec<PlannedUnit>,
}

/// A run of a candidate that is there.
pub struct StoredRun<'p> {
    /// The number of its unit in the plan: units of one number are on one stream.
    pub unit: usize,
    place: &'p Unit,
    /// Position of its setting among the candidates.
    pub candidate: usize,
    /// Its error in normalised units; infinite if it diverged.
    pub rmse: f64,
}

impl StoredRun<'_> {
    /// The sensor that its agent predicts.
    pub fn sensor(&self) -> &str {
        &self.place.sensor
    }

    /// What its agent is trained in.
    pub fn environment(&self) -> EnvironmentId {
        self.place.environment
    }
}

impl PlannedSweep {
    /// Those of this plan; `arithmetic` names what agents are trained with, if it is not calib's own.
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

    /// These, of a sweep that begins.
    pub(crate) fn begun_for(self, study: &Study) -> Self {
        Self { study: Some(study.clone()), ..self }
    }

    /// The study that the sweep was begun for; none if an earlier calib began it.
    pub fn study(&self) -> Option<&Study> {
        self.study.as_ref()
    }

    /// # Errors
    /// If it cannot be written.
    pub(crate) fn write(&self, directory: &Path) -> Result<(), StepError> {
        Ok(write_sealed_json(&directory.join(FILE), self)?)
    }

    /// That of the sweep in `directory`, if it was begun.
    pub fn read(directory: &Path) -> Option<Self> {
        let planned: Self = read_sealed_json(&directory.join(FILE)).ok()?;
        (planned.format == FORMAT).then_some(planned)
    }

    /// The sensors, in their order.
    pub fn sensors(&self) -> Vec<&str> {
        let mut sensors: Vec<&str> =
            self.units.iter().map(|planned| planned.unit.sensor.as_str()).collect();
        sensors.dedup();
        sensors
    }

    /// Runs of a sensor in all; in a race, at most.
    pub fn runs_of(&self, sensor: &str) -> usize {
        let units = self.units.iter().filter(|planned| planned.unit.sensor == sensor);
        units.count() * self.settings.len()
    }

    /// The runs that are in the store of the sweep in `directory`.
    pub fn stored_in(&self, directory: &Path) -> Vec<StoredRun<'_>> {
        let store = unit_store(directory, self.arithmetic.as_deref());
        self.stored(&|unit, key| store.get(unit, key))
    }

    /// The runs that `look_up` finds by unit and key.
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

    /// Whether the rule looks at runs in this environment.
    pub fn counts(&self, environment: EnvironmentId) -> bool {
        match environment {
            EnvironmentId::Online => false,
            EnvironmentId::LogReplay => {
                matches!(self.rule, Rule::Pooled | Rule::LogReplay | Rule::OneStandardError)
            }
            EnvironmentId::Member(_) => self.rule != Rule::LogReplay || !self.replays_the_log(),
        }
    }

    /// The environments that it has and that the rule looks at, once for each unit in them.
    pub fn environments_that_count(&self) -> Vec<EnvironmentId> {
        let all = self.units.iter().map(|planned| planned.unit.environment);
        all.filter(|environment| self.counts(*environment)).collect()
    }

    fn replays_the_log(&self) -> bool {
        self.units.iter().any(|planned| planned.unit.environment == EnvironmentId::LogReplay)
    }
}
