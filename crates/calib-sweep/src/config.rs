use std::{collections::BTreeMap, fmt};

use calib_agent::Part;
use calib_model::StartKind;
use schemars::JsonSchema;
use serde::{
    Deserialize, Deserializer, Serialize,
    de::{self, IntoDeserializer as _, Visitor},
};

use crate::{Axis, Sampling};

/// The `[sweep]` section of a study.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SweepConfig {
    /// Sensors to predict. Each has its own sweep and verdict.
    pub sensors: Vec<String>,
    /// Steps of every training run (default 30000, as in the paper). They are shortened to the held-out period if that is shorter, so that
    /// errors in all environments cover the same number of steps.
    pub steps: usize,
    /// Runs of every setting on held-out data (default 30, as in the paper), assigned to its windows in turn.
    pub online_runs: usize,
    /// Maximum number of windows of the held-out period that are replayed (default 8). Windows do not overlap, so that fewer may fit.
    pub online_windows: usize,
    /// Runs of every setting in each ensemble member (default 10, as in the paper).
    pub member_runs: usize,
    /// Runs of every setting in a network model, which has one ensemble member (default: `member_runs`).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub network_runs: Option<usize>,
    /// Runs of every setting on replayed windows of the training range (default 10; 0 for no log replay).
    pub log_replay_runs: usize,
    /// Start states of the rollouts that agents are trained in (default: those of `[rollout]`).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start: Option<StartKind>,
    /// The steps that count for the error (default: the whole run, or the final quarter for pre-trained agents).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scored: Option<Part>,
    /// Points of the learning curve that each run stores (default 50; 0 for none).
    pub curve_points: usize,
    /// Which settings are tried: `grid` (all combinations, the default), `random` or `sobol`.
    pub sampling: Sampling,
    /// Number of settings that `random` and `sobol` draw (default 20).
    pub samples: usize,
    /// Whether inferior settings stop making runs (default: all settings make all runs).
    #[serde(deserialize_with = "race_kind")]
    pub race: RaceKind,
    /// Agent field → values. The settings are all combinations of the values, the first field varying slowest.
    pub grid: BTreeMap<String, Axis>,
}

/// Whether inferior settings stop making runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RaceKind {
    /// All settings make all runs.
    #[default]
    None,
    /// The worse half of the settings stops, repeatedly.
    Halving,
}

/// The error for `"sure"` and `true`, which selected a race that no longer exists.
const RACE_BY_CERTAINTY: &str = "the race by certainty is gone. Write \"halving\", which saves more \
    runs and chooses as well, or \"none\", which makes all runs";

/// Reads the kind of race: its name, or `false`, which older studies use for no race.
fn race_kind<'de, D: Deserializer<'de>>(deserializer: D) -> Result<RaceKind, D::Error> {
    struct Spelt;
    impl Visitor<'_> for Spelt {
        type Value = RaceKind;

        fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
            formatter.write_str("\"none\" or \"halving\"")
        }

        fn visit_bool<E: de::Error>(self, is_race: bool) -> Result<RaceKind, E> {
            if is_race { Err(E::custom(RACE_BY_CERTAINTY)) } else { Ok(RaceKind::None) }
        }

        fn visit_str<E: de::Error>(self, name: &str) -> Result<RaceKind, E> {
            match name {
                "sure" => Err(E::custom(RACE_BY_CERTAINTY)),
                _ => RaceKind::deserialize(name.into_deserializer()),
            }
        }
    }
    deserializer.deserialize_any(Spelt)
}

impl SweepConfig {
    /// Returns the number of runs per setting in a network model.
    pub fn runs_of_network(&self) -> usize {
        self.network_runs.unwrap_or(self.member_runs)
    }
}

impl Default for SweepConfig {
    fn default() -> Self {
        let rates = [1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2];
        Self {
            sensors: Vec::new(),
            steps: 30_000,
            online_runs: 30,
            online_windows: 8,
            member_runs: 10,
            network_runs: None,
            log_replay_runs: 10,
            start: None,
            scored: None,
            curve_points: 50,
            sampling: Sampling::Grid,
            samples: 20,
            race: RaceKind::None,
            grid: BTreeMap::from([(
                "learning_rate".to_owned(),
                Axis::List(rates.map(Into::into).to_vec()),
            )]),
        }
    }
}
