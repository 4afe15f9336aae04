use std::fmt;

use calib_agent::{Part, RunOutcome, Scores};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{EnvironmentId, NotFinite};

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

/// A unit and the fingerprint of everything that its result follows from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct PlannedUnit {
    /// The unit.
    pub unit: Unit,
    /// The fingerprint.
    pub key: String,
}

/// What a unit gave.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct UnitResult {
    /// Fingerprint of everything that the result follows from.
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
    /// One row a candidate, in the order of the candidates that were trained.
    pub rows: Vec<RunRow>,
}

/// The result of one run of one candidate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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

/// A point of a learning curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CurvePoint {
    /// The step after the window's last.
    pub step: usize,
    /// RMSE over the window.
    #[serde(with = "infinite")]
    pub rmse: f64,
}

/// JSON has no infinity: a diverged error is stored as `null`.
pub(crate) mod infinite {
    use serde::{Deserialize as _, Deserializer, Serialize as _, Serializer};

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde prescribes the signature")]
    pub(crate) fn serialize<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
        value.is_finite().then_some(*value).serialize(serializer)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
        Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
    }
}

impl RunRow {
    /// Of a run whose rollout left the finite numbers after `steps` steps: there is nothing to hold an agent to.
    pub(crate) fn failed(candidate: usize, steps: usize) -> Self {
        Self {
            candidate,
            steps,
            updates: 0,
            scores: Scores::default(),
            diverged_at: Some(steps),
            curve: Vec::new(),
        }
    }

    /// Of a run of `steps` steps between which nothing is missing.
    pub fn new(candidate: usize, steps: usize, outcome: RunOutcome) -> Self {
        let point =
            |point: calib_agent::CurvePoint| CurvePoint { step: point.step, rmse: point.rmse };
        Self {
            candidate,
            steps,
            updates: outcome.updates,
            scores: outcome.scores,
            diverged_at: outcome.diverged,
            curve: outcome.curve.into_iter().map(point).collect(),
        }
    }

    /// RMSE over one part, in normalised units: +∞ if the run diverged, none if no step of the part can be scored.
    pub fn rmse(&self, part: Part) -> Option<f64> {
        match self.diverged_at {
            Some(_) => Some(f64::INFINITY),
            None => Some(self.scores.of(part)?.rmse),
        }
    }
}
