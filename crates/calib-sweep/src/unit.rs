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

/// One unit of a sweep: all candidates trained to predict one sensor on one stream.
#[derive(
    Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
pub struct Unit {
    /// The predicted sensor.
    pub sensor: String,
    /// Where the stream comes from.
    pub environment: EnvironmentId,
    /// Number of the run.
    pub run: usize,
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} in {}, run {}", self.sensor, self.environment, self.run)
    }
}

/// A unit, what its runs have in common, and which settings it trains.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct PlannedUnit {
    /// The unit.
    pub unit: Unit,
    /// Fingerprint of everything that its runs follow from beside their settings.
    pub key: String,
    /// Positions of the candidates that a race dropped before this unit.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub dropped: BTreeSet<usize>,
}

impl PlannedUnit {
    /// The candidates that are trained, with their keys, where `settings` are the keys of all candidates.
    pub(crate) fn trained<'s, S: AsRef<str>>(
        &'s self,
        settings: &'s [S],
    ) -> impl Iterator<Item = (usize, &'s str)> + 's {
        let settings = settings.iter().map(AsRef::as_ref);
        settings.enumerate().filter(|(candidate, _)| !self.dropped.contains(candidate))
    }

    /// Fingerprint of everything that its results follow from, where `settings` are the keys of all candidates.
    pub fn fingerprint<S: AsRef<str>>(&self, settings: &[S]) -> String {
        let mut all = Fingerprinter::default();
        all.add(self.key.as_bytes());
        for (_, setting) in self.trained(settings) {
            all.add(setting.as_bytes());
        }
        all.finish().to_string()
    }
}

/// The runs of a unit that are kept, whatever grid they were made for: a run follows from its unit and its own setting
/// alone, so a larger or smaller grid finds those that it shares with this one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct UnitRuns {
    /// Fingerprint of everything that the runs follow from beside their settings.
    pub key: String,
    /// Which unit.
    pub unit: Unit,
    /// Seed of the agents.
    pub seed: u64,
    /// Row of the training data (or of the held-out data) that the stream starts from.
    pub start_row: u32,
    /// Where the model's rollout left the finite numbers, if it did: nothing was trained, and all errors are infinite.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub not_finite: Option<NotFinite>,
    /// Each run, by the key of its setting.
    pub runs: BTreeMap<String, SettingRun>,
}

impl UnitRuns {
    /// Take the runs of `other` that are not there, if they are runs of the same unit and inputs.
    pub fn merge(&mut self, other: Self) {
        if self.is_of(&other.unit, &other.key) {
            for (setting, run) in other.runs {
                self.runs.entry(setting).or_insert(run);
            }
        }
    }

    /// The runs of one unit that are in several places, together; none where no place has any.
    pub fn merged(places: impl IntoIterator<Item = Self>) -> Option<Self> {
        places.into_iter().reduce(|mut all, more| {
            all.merge(more);
            all
        })
    }

    /// The rows that are there of the candidates of a planned unit, where `settings` are the keys of all candidates.
    pub fn of<S: AsRef<str>>(&self, planned: &PlannedUnit, settings: &[S]) -> Vec<RunRow> {
        self.rows(planned.trained(settings)).flatten().collect()
    }

    /// Whether these are runs of `unit`, made from the inputs that `key` stands for.
    pub(crate) fn is_of(&self, unit: &Unit, key: &str) -> bool {
        self.key == key && self.unit == *unit
    }

    /// The result of these candidates, each with the key of its setting, if all their runs are there.
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

    /// The row of each of these candidates whose run is there.
    pub(crate) fn rows<'s>(
        &self,
        candidates: impl Iterator<Item = (usize, &'s str)>,
    ) -> impl Iterator<Item = Option<RunRow>> {
        candidates.map(|(candidate, setting)| self.runs.get(setting).map(|run| run.row(candidate)))
    }
}

/// One run of one setting.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SettingRun {
    /// Steps of the run, between which nothing is missing.
    pub steps: usize,
    /// Mini-batch or online updates.
    pub updates: u64,
    /// Errors over each part of the run, in normalised units.
    pub scores: Scores,
    /// Step at which a value ceased to be finite: of the agent, or of the rollout that it should have learnt from.
    pub diverged_at: Option<usize>,
    /// The learning curve.
    pub curve: Vec<CurvePoint>,
}

impl SettingRun {
    /// Of a run whose rollout left the finite numbers after `steps` steps: there is nothing to hold an agent to.
    pub(crate) fn failed(steps: usize) -> Self {
        Self {
            steps,
            updates: 0,
            scores: Scores::default(),
            diverged_at: Some(steps),
            curve: Vec::new(),
        }
    }

    /// Of a run of `steps` steps between which nothing is missing.
    pub(crate) fn new(steps: usize, outcome: RunOutcome) -> Self {
        Self {
            steps,
            updates: outcome.updates,
            scores: outcome.scores,
            diverged_at: outcome.diverged,
            curve: outcome.curve,
        }
    }

    /// The run as one of the candidate at this position.
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

/// What a unit gave.
#[derive(Clone, Debug, PartialEq)]
pub struct UnitResult {
    /// Fingerprint of everything that the result follows from beside the settings.
    pub key: String,
    /// Which unit.
    pub unit: Unit,
    /// Seed of the agents.
    pub seed: u64,
    /// Row of the training data (or of the held-out data) that the stream starts from.
    pub start_row: u32,
    /// Where the model's rollout left the finite numbers, if it did: nothing was trained, and all errors are infinite.
    pub not_finite: Option<NotFinite>,
    /// One row a candidate, in the order of the candidates that were trained.
    pub rows: Vec<RunRow>,
}

/// The result of one run of one candidate.
#[derive(Clone, Debug, PartialEq)]
pub struct RunRow {
    /// Position of the candidate in the sweep.
    pub candidate: usize,
    /// Steps of the run, between which nothing is missing.
    pub steps: usize,
    /// Mini-batch or online updates.
    pub updates: u64,
    /// Errors over each part of the run, in normalised units.
    pub scores: Scores,
    /// Step at which a value ceased to be finite: of the agent, or of the rollout that it should have learnt from.
    pub diverged_at: Option<usize>,
    /// The learning curve.
    pub curve: Vec<CurvePoint>,
}

impl RunRow {
    /// Of a run of `steps` steps between which nothing is missing.
    pub fn new(candidate: usize, steps: usize, outcome: RunOutcome) -> Self {
        SettingRun::new(steps, outcome).row(candidate)
    }

    /// RMSE over one part, in normalised units: +∞ if the run diverged, none if no step of the part can be scored.
    pub fn rmse(&self, part: Part) -> Option<f64> {
        match self.diverged_at {
            Some(_) => Some(f64::INFINITY),
            None => Some(self.scores.of(part)?.rmse),
        }
    }
}
