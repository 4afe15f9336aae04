//! Rows about the data, the rollouts, and how the report was made.

/// How far the rollouts of one member are from a replay of the log.
#[derive(Debug, Clone, PartialEq)]
pub struct JumpStatistics {
    /// The calibration model.
    pub model: String,
    /// Its member.
    pub member: usize,
    /// Steps counted.
    pub steps: u64,
    /// Share of steps that did not go to the next row of the log.
    pub jump_rate: f64,
    /// Share of steps that went to another time of the log.
    pub departure_rate: f64,
    /// Mean number of steps between two jumps.
    pub mean_run_length: f64,
    /// A warning, for example that the rollout is nearly a verbatim replay.
    pub note: Option<String>,
}

/// What the data looked like, and what was kept of it.
#[derive(Debug, Clone, PartialEq)]
pub struct DataProfile {
    /// Rows used.
    pub rows: u64,
    /// Segments: maximal runs without a gap.
    pub segments: u64,
    /// Seconds from one row to the next.
    pub period_secs: f64,
    /// Time of the first row, as text.
    pub first: String,
    /// Time of the last row, as text.
    pub last: String,
    /// Anything else, as name and value: "held-out rows", "duplicates dropped".
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
    /// Smallest value, in that unit; `None` if there is none.
    pub min: Option<f64>,
    /// Largest value, in that unit.
    pub max: Option<f64>,
    /// Share of rows without a value.
    pub missing: f64,
    /// Whether it is part of the states.
    pub status: ChannelStatus,
}

/// Whether a channel is part of the states.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ChannelStatus {
    /// It is.
    Kept,
    /// It was left out, for this reason.
    Dropped(String),
}

/// How to make the report again.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Reproduction {
    /// The command line.
    pub command: String,
    /// The study file, resolved: with all defaults and overrides.
    pub study_toml: String,
    /// Programs and packages with their versions.
    pub versions: Vec<(String, String)>,
    /// Seeds by name.
    pub seeds: Vec<(String, u64)>,
    /// Fingerprint of the data.
    pub fingerprint: String,
}
