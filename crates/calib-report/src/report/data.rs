//! Rows about the data, the rollouts, and the reproduction of the report.

/// Difference between the rollouts of one ensemble member and a replay of the log.
#[derive(Debug, Clone, PartialEq)]
pub struct JumpStatistics {
    /// The calibration model.
    pub model: String,
    /// Number of the ensemble member.
    pub member: usize,
    /// Number of counted steps.
    pub steps: u64,
    /// Share of steps that are jumps: they do not go to the next row of the log.
    pub jump_rate: f64,
    /// Share of steps that go to another time of the log.
    pub departure_rate: f64,
    /// Mean number of steps between two jumps.
    pub mean_run_length: f64,
    /// A warning, for example that the rollout is nearly a verbatim replay.
    pub note: Option<String>,
}

/// Summary of the data before and after preprocessing.
#[derive(Debug, Clone, PartialEq)]
pub struct DataProfile {
    /// Number of rows used.
    pub rows: u64,
    /// Number of segments: maximal runs without a gap.
    pub segments: u64,
    /// Seconds between rows.
    pub period_secs: f64,
    /// Time of the first row, as text.
    pub first: String,
    /// Time of the last row, as text.
    pub last: String,
    /// Further facts as name and value: "held-out rows", "duplicates dropped".
    pub facts: Vec<(String, String)>,
    /// Every channel of the log.
    pub channels: Vec<Channel>,
}

/// One channel of the log.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Its name.
    pub name: String,
    /// Its physical unit.
    pub unit: Option<String>,
    /// Smallest value, in that unit; `None` if there are no values.
    pub min: Option<f64>,
    /// Largest value, in that unit; `None` if there are no values.
    pub max: Option<f64>,
    /// Share of rows without a value.
    pub missing: f64,
    /// Whether it is part of the states.
    pub status: ChannelStatus,
}

/// Whether a channel is part of the states.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ChannelStatus {
    /// The channel is part of the states.
    Kept,
    /// The channel was left out, for this reason.
    Dropped(String),
}

/// Instructions to make the report again.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Reproduction {
    /// The command line.
    pub command: String,
    /// The resolved study file, with all defaults and overrides.
    pub study_toml: String,
    /// Programs and packages with their versions.
    pub versions: Vec<(String, String)>,
    /// Seeds by name.
    pub seeds: Vec<(String, u64)>,
    /// Fingerprint of the data.
    pub fingerprint: String,
}
