use std::{
    collections::{BTreeMap, BTreeSet},
    fmt,
};

use calib_agent::{CurvePoint, Part, RunOutcome, Scores};
use calib_files::Fingerprinter;
use calib_model::NotFinite;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::EnvironmentId;

/// One unit of a sweep: all settings trained to predict one sensor on one stream.
#[derive(
    Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
pub struct Unit {
    /// The predicted sensor.
    pub sensor: String,
    /// The environment of the stream.
    pub environment: EnvironmentId,
    /// Index of the run.
    pub run: usize,
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} in {}, run {}", self.sensor, self.environment, self.run)
    }
}

/// A unit with its fingerprint, and the settings that it trains.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct PlannedUnit {
    /// The unit.
    pub unit: Unit,
    /// Fingerprint of everything that its runs depend on, except their settings.
    pub key: String,
    /// Indices of the settings that a race dropped before this unit.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub dropped: BTreeSet<usize>,
}

impl PlannedUnit {
    /// Returns the trained settings with their keys. `settings` are the keys of all settings.
    pub(crate) fn trained<'s, S: AsRef<str>>(
        &'s self,
        settings: &'s [S],
    ) -> impl Iterator<Item = (usize, &'s str)> + 's {
        let settings = settings.iter().map(AsRef::as_ref);
        settings.enumerate().filter(|(candidate, _)| !self.dropped.contains(candidate))
    }

    /// Returns the fingerprint of all inputs of the unit's results. `settings` are the keys of all settings.
    pub fn fingerprint<S: AsRef<str>>(&self, settings: &[S]) -> String {
        let mut all = Fingerprinter::default();
        all.add(self.key.as_bytes());
        for (_, setting) in self.trained(settings) {
            all.add(setting.as_bytes());
        }
        all.finish().to_string()
    }
}

/// The stored runs of a unit, from any grid. A run depends only on its unit and its own setting. So a larger or
/// smaller grid reuses the runs that it shares with this one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct UnitRuns {
    /// Fingerprint of all inputs of the runs except their settings.
    pub key: String,
    /// The unit.
    pub unit: Unit,
    /// Seed of the agents.
    pub seed: u64,
    /// Row of the training data (or the held-out data) that the stream starts from.
    pub start_row: u32,
    /// Where the model's rollout ceased to be finite, if it did. In that case nothing was trained, and all errors are
    /// infinite.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub not_finite: Option<NotFinite>,
    /// Each run, by the key of its setting.
    pub runs: BTreeMap<String, SettingRun>,
}

impl UnitRuns {
    /// Adds the missing runs from `other`, if it holds runs of the same unit and inputs.
    pub fn merge(&mut self, other: Self) {
        if self.is_of(&other.unit, &other.key) {
            for (setting, run) in other.runs {
                self.runs.entry(setting).or_insert(run);
            }
        }
    }

    /// Merges the runs of one unit from several places. Returns `None` if no place has any.
    pub fn merged(places: impl IntoIterator<Item = Self>) -> Option<Self> {
        places.into_iter().reduce(|mut all, more| {
            all.merge(more);
            all
        })
    }

    /// Returns the available rows of the settings of a planned unit. `settings` are the keys of all settings.
    pub fn of<S: AsRef<str>>(&self, planned: &PlannedUnit, settings: &[S]) -> Vec<RunRow> {
        self.rows(planned.trained(settings)).flatten().collect()
    }

    /// Whether these are runs of `unit` from the inputs with the fingerprint `key`.
    pub(crate) fn is_of(&self, unit: &Unit, key: &str) -> bool {
        self.key == key && self.unit == *unit
    }

    /// Returns the result of these settings (with their keys), if all runs are there.
    pub(crate) fn result<'s>(
        &self,
        candidates: impl Iterator<Item = (usize, &'s str)>,
    ) -> Option<UnitResult> {
        let rows = self.rows(candidates).collect::<Option<_>>()?;
        Some(UnitResult {
            key: self.key.clone(),
            unit: self.unit.clone(),
            seed: self.seed,
            start_row: self.start_row,
            not_finite: self.not_finite,
            rows,
        })
    }

    /// Returns the rows of these settings whose runs are there.
    pub(crate) fn rows<'s>(
        &self,
        candidates: impl Iterator<Item = (usize, &'s str)>,
    ) -> impl Iterator<Item = Option<RunRow>> {
        candidates.map(|(candidate, setting)| self.runs.get(setting).map(|run| run.row(candidate)))
    }
}

/// One training run of one setting.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SettingRun {
    /// Steps of the run within its unbroken pieces.
    pub steps: usize,
    /// Mini-batch or online updates.
    pub updates: u64,
    /// Errors over each part of the run, in normalised units.
    pub scores: Scores,
    /// Step at which a value ceased to be finite, either in the agent or in the rollout that it was to learn from.
    pub diverged_at: Option<usize>,
    /// The learning curve.
    pub curve: Vec<CurvePoint>,
}

impl SettingRun {
    /// Creates the run for a rollout that ceased to be finite after `steps` steps, so that there is no return to score
    /// against.
    pub(crate) fn failed(steps: usize) -> Self {
        Self {
            steps,
            updates: 0,
            scores: Scores::default(),
            diverged_at: Some(steps),
            curve: Vec::new(),
        }
    }

    /// Creates the run from an outcome over `steps` steps within unbroken pieces.
    pub(crate) fn new(steps: usize, outcome: RunOutcome) -> Self {
        Self {
            steps,
            updates: outcome.updates,
            scores: outcome.scores,
            diverged_at: outcome.diverged,
            curve: outcome.curve,
        }
    }

    /// Returns the run as the row of the setting at position `candidate`.
    fn row(&self, candidate: usize) -> RunRow {
        let Self { steps, updates, scores, diverged_at, curve } = self.clone();
        RunRow { candidate, steps, updates, scores, diverged_at, curve }
    }
}

impl From<&RunRow> for SettingRun {
    fn from(row: &RunRow) -> Self {
        let RunRow { candidate: _, steps, updates, scores, diverged_at, curve } = row.clone();
        Self { steps, updates, scores, diverged_at, curve }
    }
}

/// The result of one unit.
#[derive(Clone, Debug, PartialEq)]
pub struct UnitResult {
    /// Fingerprint of all inputs of the result except the settings.
    pub key: String,
    /// The unit.
    pub unit: Unit,
    /// Seed of the agents.
    pub seed: u64,
    /// Row of the training data (or the held-out data) that the stream starts from.
    pub start_row: u32,
    /// Where the model's rollout ceased to be finite, if it did. In that case nothing was trained, and all errors are
    /// infinite.
    pub not_finite: Option<NotFinite>,
    /// One row per trained setting, in order.
    pub rows: Vec<RunRow>,
}

/// The result of one training run of one setting.
#[derive(Clone, Debug, PartialEq)]
pub struct RunRow {
    /// Position of the setting in the sweep.
    pub candidate: usize,
    /// Steps of the run within its unbroken pieces.
    pub steps: usize,
    /// Mini-batch or online updates.
    pub updates: u64,
    /// Errors over each part of the run, in normalised units.
    pub scores: Scores,
    /// Step at which a value ceased to be finite, either in the agent or in the rollout that it was to learn from.
    pub diverged_at: Option<usize>,
    /// The learning curve.
    pub curve: Vec<CurvePoint>,
}

impl RunRow {
    /// Creates the row of a run of `steps` steps within unbroken pieces.
    pub fn new(candidate: usize, steps: usize, outcome: RunOutcome) -> Self {
        SettingRun::new(steps, outcome).row(candidate)
    }

    /// Returns the RMSE over `part`, in normalised units: +∞ if the run diverged, `None` if no step of the part can be
    /// scored.
    pub fn rmse(&self, part: Part) -> Option<f64> {
        match self.diverged_at {
            Some(_) => Some(f64::INFINITY),
            None => Some(self.scores.of(part)?.rmse),
        }
    }
}
