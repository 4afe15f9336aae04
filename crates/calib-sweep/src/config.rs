use std::collections::BTreeMap;

use calib_agent::Scoring;
use serde::{Deserialize, Serialize};

use crate::{Axis, HalvingConfig, Sampling};

/// The `[sweep]` section of a study.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SweepConfig {
    /// Sensors to predict; each gets a sweep and a verdict of its own.
    pub sensors: Vec<String>,
    /// Steps of every stream (default 30000, as in the paper). Shortened to the held-out range
    /// if that is shorter, so that errors in all environments cover equally many steps.
    pub steps: usize,
    /// Runs of every value on the held-out replay (default 30, as in the paper).
    pub online_runs: usize,
    /// Runs of every value in each member (default 10, as in the paper).
    pub member_runs: usize,
    /// Runs of every value on replayed windows of the training range (default 10; 0 leaves it out).
    pub log_replay_runs: usize,
    /// Which steps count: `final_quarter` (default) or `whole_run`.
    pub scored: Scored,
    /// Points of the learning curve that each run stores (default 50; 0 stores none).
    pub curve_points: usize,
    /// Which combinations of the values are tried: `grid` (default), `random` or `sobol`.
    pub sampling: Sampling,
    /// Combinations that `random` and `sobol` draw (default 20).
    pub samples: usize,
    /// Drop hopeless values after a few runs of every member (default: none is dropped).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub halving: Option<HalvingConfig>,
    /// Agent field → values. A grid of several fields is their Cartesian product, the first varying slowest.
    pub grid: BTreeMap<String, Axis>,
}

/// Which steps of a run its error is taken over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scored {
    /// Every step whose return is complete.
    WholeRun,
    /// The last 25 % of the steps, so that early learning does not dominate.
    FinalQuarter,
}

impl From<Scored> for Scoring {
    fn from(scored: Scored) -> Self {
        match scored {
            Scored::WholeRun => Self::WholeRun,
            Scored::FinalQuarter => Self::Final(0.25),
        }
    }
}

impl Default for SweepConfig {
    fn default() -> Self {
        let rates = [1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2];
        Self {
            sensors: Vec::new(),
            steps: 30_000,
            online_runs: 30,
            member_runs: 10,
            log_replay_runs: 10,
            scored: Scored::FinalQuarter,
            curve_points: 50,
            sampling: Sampling::Grid,
            samples: 20,
            halving: None,
            grid: BTreeMap::from([(
                "learning_rate".to_owned(),
                Axis::List(rates.map(Into::into).to_vec()),
            )]),
        }
    }
}
