//! The comparison of rollouts with the record, as the manifest of rollouts has it.

use calib_stats::ClusterSummary;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Comparison of rollouts with recorded trajectories, in the manifest of the rollouts.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Comparison {
    /// Number of rollouts of all ensemble members that were compared.
    pub(crate) rollouts: usize,
    /// Number of requested start states. Ensemble members share them, so intervals are over them.
    pub(crate) start_states: usize,
    /// Number of start states whose recorded trajectories share steps with another one: these count as independent, but
    /// are less so.
    pub(crate) overlapping: usize,
    /// Rollouts that were left out because the recorded trajectory after their start state is too short.
    pub(crate) left_out: usize,
    /// Rollouts that were left out because they ended before the steps to compare (their next state would not have been
    /// finite). Distances over the few remaining steps would flatter the model.
    pub(crate) ended_early: usize,
    /// Smallest and largest number of steps that were compared; 0 if no rollout was.
    pub(crate) fewest_steps: usize,
    pub(crate) most_steps: usize,
    /// The source of the recorded trajectories.
    pub(crate) against: Against,
    /// One entry for each sensor; empty if no rollout was compared.
    pub sensors: Vec<SensorComparison>,
}

/// The source of the recorded trajectories.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Against {
    /// The data of the model, after the start state.
    Model,
    /// The deployment, after the state that the start state represents.
    Deployment,
}

/// Distances on one normalised sensor: means over start states of the means over ensemble members.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct SensorComparison {
    /// Name of the sensor.
    pub sensor: String,
    /// One entry for each step pattern.
    pub dtw: Vec<PatternSummary>,
    pub(crate) measures: Vec<MeasureSummary>,
}

/// Dynamic time warping with one step pattern.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct PatternSummary {
    pub(crate) step_pattern: String,
    /// Weighted sum of the local distances along the warping path.
    pub distance: ClusterSummary,
    /// The distance with the normalisation of the step pattern; `None` if the pattern has none.
    pub normalized_distance: Option<ClusterSummary>,
}

/// Another measure of distance.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub(crate) struct MeasureSummary {
    /// Column of the measure in `measures.parquet`.
    pub(crate) measure: String,
    /// Mean of the measure; `None` if it is defined for no rollout.
    pub(crate) value: Option<ClusterSummary>,
}
