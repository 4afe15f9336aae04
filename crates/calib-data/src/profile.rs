//! The description of a log that `calib inspect` shows.

use calib_core::Timestamp;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    AngleOf, BadRowsFound, ContradictionCause, DataError, Description, DropReason, Fences,
    Sentinel, Shape, UnitChange, angle_hint, similar_names::hint,
};

/// Description of a log, and of the states that preprocessing makes of it.
///
/// All counts are over the window that the training and held-out ranges span together; `rows_outside` counts the rows before and after this
/// window.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is a fact of its own in the JSON of `calib inspect`"
)]
pub struct Profile {
    /// The content of one row of the files. Default: `wide`.
    #[serde(default, skip_serializing_if = "Shape::is_wide")]
    pub shape: Shape,
    /// Whether times are UTC, because the log or the study has a time zone. If false, times are as recorded. Default: false.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub utc: bool,
    /// Samples of a long table that are missing because of their quality code. Default: 0.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub bad_quality: u64,
    /// Lines of text files that were skipped because they cannot be read. Default: none.
    #[serde(default, skip_serializing_if = "BadRowsFound::is_none")]
    pub bad_rows: BadRowsFound,
    /// Whether the files have no times, so that rows are counted instead. Default: false.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub without_times: bool,
    /// Sentences about columns that are not read one by one, such as times that are joined from several columns. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub read_as: Vec<String>,
    /// Numbers that probably mean a missing value and are not in `data.missing_values`. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sentinels: Vec<Sentinel>,
    /// Values of the same channel and time that differ. Default: none.
    #[serde(default, skip_serializing_if = "ContradictionsFound::is_none")]
    pub contradictions: ContradictionsFound,
    /// Number of files.
    pub files: usize,
    /// Size of the files in bytes.
    pub bytes: u64,
    /// Rows in the files.
    pub file_rows: u64,
    /// Rows in time order, one for each instant.
    pub rows: u64,
    /// Whether these rows are at the common times of `data.resample`. Default: false.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub resampled: bool,
    /// Rows before or after both ranges.
    pub rows_outside: u64,
    /// Time of the first row.
    pub start: Timestamp,
    /// Time of the last row.
    pub end: Timestamp,
    /// Time from one sample to the next in the log, in seconds.
    pub period_secs: f64,
    /// Whether the period is the median step of the log. If false, it was configured.
    pub period_was_detected: bool,
    /// The median step in seconds, if it contradicts a configured period: nearly all steps have this length, or most steps are gaps.
    /// Default: none was.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recorded_period_secs: Option<f64>,
    /// Time from one row of the states to the next, in seconds: after sub-sampling.
    pub sampled_period_secs: f64,
    /// Rows without a timestamp; they are dropped.
    pub null_timestamps: u64,
    /// Rows among these whose local time is in an hour that clocks showed twice, or never, when summer time ended or began, and that no
    /// other row decides. Default: 0.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub undecided_times: u64,
    /// Rows with the same timestamp as another row.
    pub duplicates: Duplicates,
    /// Rows that were merged with a row of another file that has none of their channels. Default: 0.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub merged_rows: u64,
    /// Steps back in time inside a file.
    pub backward_steps: BackwardSteps,
    /// Files that start before an earlier file has ended; they are merged by time.
    pub overlapping_files: u64,
    /// Steps shorter than the period divided by `data.gap_tolerance`; they are tolerated.
    pub short_steps: u64,
    /// Steps longer than the period times `data.gap_tolerance`; segments end there.
    pub gaps: Gaps,
    /// The channels, in the order in which the files have them.
    pub channels: Vec<ChannelProfile>,
    /// Entries of `data.exclude` that match no channel.
    pub unused_excludes: Vec<String>,
    /// Columns of the states: kept channels and features.
    pub columns: usize,
    /// The training range.
    pub train: PartProfile,
    /// The held-out range, if there is one.
    pub held_out: Option<PartProfile>,
    /// Rows of the held-out range whose mode does not occur in the training range.
    pub unseen_modes: u64,
    /// Memory of the states, in bytes.
    pub state_bytes: u64,
}

/// Different values of one channel at the same time.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ContradictionsFound {
    /// Number of values that differ from the one that is kept.
    pub count: u64,
    /// How many of them are in the channel with the most. Default: 0.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub most_of_channel: u64,
    /// Some of them, in words.
    pub examples: Vec<String>,
    /// The cause, if known. Default: unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cause: Option<ContradictionCause>,
}

/// `calib init` accepts a log with contradicting values in at most this share of the rows, and keeps the first value. A
/// clock that was set back or overlapping recordings cause so few. With more, the log is read wrongly. Our choice.
pub const FEW_CONTRADICT: f64 = 0.01;

impl ContradictionsFound {
    /// Whether there are so few contradictions in a log of `rows` rows that `calib init` accepts it.
    pub fn are_few(&self, rows: u64) -> bool {
        let is_of_plants = matches!(self.cause, Some(ContradictionCause::Column { .. }));
        self.count > 0
            && !is_of_plants
            && self.most_of_channel as f64 <= FEW_CONTRADICT * rows as f64
    }

    fn is_none(&self) -> bool {
        self.count == 0
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde wants a reference")]
fn is_zero(count: &u64) -> bool {
    *count == 0
}

/// Rows with the same timestamp as another row. The first one is kept.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Duplicates {
    /// Rows that contradict the kept row in no channel.
    pub identical: u64,
    /// Rows with a different value in a channel that the kept row also has.
    pub conflicting: u64,
    /// The first few times.
    pub examples: Vec<Timestamp>,
}

/// Steps back in time inside a file, such as at the end of daylight saving. Rows are sorted by time.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BackwardSteps {
    /// Number of steps.
    pub count: u64,
    /// The first few.
    pub examples: Vec<BackwardStep>,
}

/// A step back in time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BackwardStep {
    /// The file.
    pub file: String,
    /// Time before the step.
    pub from: Timestamp,
    /// Time after the step.
    pub to: Timestamp,
}

/// Steps that are too long for one sample.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Gaps {
    /// Number of gaps.
    pub count: u64,
    /// Length of the longest gap, in seconds.
    pub longest_secs: f64,
    /// Total length of all gaps, in seconds.
    pub total_secs: f64,
    /// The longest gaps, the longest first: last row before the gap, first row after it.
    pub examples: Vec<(Timestamp, Timestamp)>,
}

/// One channel of the log.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ChannelProfile {
    /// Name of the channel.
    pub name: String,
    /// Type of its column in the files.
    pub type_name: String,
    /// The angle whose sine or cosine it is, from `data.angles`. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angle: Option<AngleOf>,
    /// Its description in the header of the files. Default: none.
    #[serde(default, skip_serializing_if = "Description::is_empty")]
    pub description: Description,
    /// Why it is not a sensor of the states; `None` if it is a sensor.
    pub dropped: Option<DropReason>,
    /// Statistics of its values; `None` if it was excluded, cannot be read or has no value.
    pub values: Option<ValueProfile>,
    /// Rows without a value.
    pub missing: u64,
    /// Fraction of the training rows without a value.
    pub missing_fraction: f64,
    /// NaN and infinite values, which count as missing.
    pub non_finite: u64,
    /// Values that `data.missing_values` lists. Default: 0.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub stood_for_missing: u64,
    /// The most frequent words that are not numbers, which count as missing, with their counts.
    pub words: Vec<(String, u64)>,
    /// Spikes, and held-out values far outside of the training range. Default: none.
    #[serde(default, skip_serializing_if = "FarOut::is_none")]
    pub far_out: FarOut,
    /// A time in the training range at which its unit probably changed. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit_change: Option<UnitChange>,
    /// Stops of its recording during which the last value was held, under `data.resample`. Default: none.
    #[serde(default, skip_serializing_if = "BridgedStops::is_none")]
    pub bridged: BridgedStops,
    /// Missing values that were filled.
    pub imputed: u64,
    /// Missing values that were not filled, so that their rows were dropped.
    pub unfilled: u64,
}

/// Values of a channel that lie far from all others.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FarOut {
    /// Spikes in both ranges: single samples beyond the fences.
    pub spikes: u64,
    /// The first few spikes, with their times.
    pub examples: Vec<(Timestamp, f64)>,
    /// The fences, if the channel has any.
    pub fences: Option<Fences>,
    /// Held-out values, except treated spikes, whose distance from the training range exceeds the width of this range. For a channel that
    /// is constant in the training range: all held-out values that differ from the constant.
    pub held_out: u64,
    /// How many of these lie more than 20 widths away from the training range. Profiles of earlier versions lack it.
    #[serde(default)]
    pub elsewhere: u64,
    /// The furthest of these, in widths of the training range: −75 is 75 widths below its smallest value. 0 if the range has no width.
    pub furthest: f64,
    /// The smallest and the largest value of the training range. Default: none, if no held-out value is far out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trained: Option<[f64; 2]>,
}

impl FarOut {
    /// Whether there are no such values.
    pub fn is_none(&self) -> bool {
        self.spikes == 0 && self.held_out == 0
    }
}

/// Stops of a channel during which `data.max_age_secs` let the last value be held. A stop is longer than ten of the channel's usual steps,
/// and than ten periods.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BridgedStops {
    /// Number of stops.
    pub count: u64,
    /// Length of the longest stop, in seconds.
    pub longest_secs: f64,
    /// The usual step of the channel, in seconds.
    pub usual_secs: f64,
}

impl BridgedStops {
    /// Whether there are no such stops.
    pub fn is_none(&self) -> bool {
        self.count == 0
    }
}

/// The values of a channel, in its unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ValueProfile {
    /// Smallest value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub std: f64,
    /// Whether all values are equal.
    pub constant: bool,
    /// Longest time without any change, in seconds.
    pub longest_stuck_secs: f64,
    /// The value of that time. Default: not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stuck_at: Option<f64>,
    /// Smallest change between successive rows: the quantisation step, if the channel is quantised.
    pub smallest_change: Option<f64>,
    /// Share of successive rows without a change: near 1 for dead-band logging and modes.
    pub unchanged: f64,
    /// Number of distinct values, if there are at most 256.
    pub distinct: Option<u32>,
}

/// The rows of a range of the log, before and after preprocessing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PartProfile {
    /// Time of the first row of the log in the range.
    pub start: Timestamp,
    /// Time of the last row of the log in the range.
    pub end: Timestamp,
    /// Rows of the log in the range.
    pub log_rows: u64,
    /// Rows dropped because a value was missing.
    pub dropped_rows: u64,
    /// Rows of the states.
    pub rows: u64,
    /// Segments.
    pub segments: u64,
    /// Transitions inside segments.
    pub transitions: u64,
}

impl PartProfile {
    pub(crate) fn empty(at: Timestamp) -> Self {
        Self {
            start: at,
            end: at,
            log_rows: 0,
            dropped_rows: 0,
            rows: 0,
            segments: 0,
            transitions: 0,
        }
    }
}

impl Profile {
    /// Returns the channel called `name`.
    ///
    /// # Errors
    /// If it does not exist; the message suggests similar names.
    pub fn channel(&self, name: &str) -> Result<&ChannelProfile, DataError> {
        let found = self.channels.iter().find(|channel| channel.name == name);
        found.ok_or_else(|| {
            let names = self.channels.iter().map(|channel| channel.name.as_str());
            let mut hint = self.angle_hint(name).unwrap_or_else(|| hint(name, names));
            if hint.is_empty() {
                hint.push_str("; `calib inspect` shows all channels");
            }
            DataError::NoSuchSensor { name: name.to_owned(), hint }
        })
    }

    /// Returns a hint for users who name the angle `name` instead of one of its two channels; `None` if it is not an
    /// angle.
    pub fn angle_hint(&self, name: &str) -> Option<String> {
        angle_hint(name, self.channels.iter().filter_map(|channel| channel.angle.as_ref()))
    }

    /// Returns the name of the channel `name` in the files. For the sine or cosine of an angle, it is the name of the
    /// angle.
    pub fn recorded_name<'a>(&'a self, name: &'a str) -> &'a str {
        let recorded = self.channels.iter().find(|channel| channel.name == name);
        recorded.and_then(|channel| channel.angle.as_ref()).map_or(name, |angle| &angle.channel)
    }

    /// Checks that the channel called `name` is a sensor of the states.
    ///
    /// # Errors
    /// If there is no such channel, or it was dropped; the message gives the reason.
    pub fn require_sensor(&self, name: &str) -> Result<(), DataError> {
        match &self.channel(name)?.dropped {
            None => Ok(()),
            Some(reason) => {
                Err(DataError::SensorDropped { name: name.to_owned(), reason: reason.to_string() })
            }
        }
    }

    /// Iterates over the channels that are sensors of the states, in order.
    pub fn kept(&self) -> impl Iterator<Item = &ChannelProfile> {
        self.channels.iter().filter(|channel| channel.dropped.is_none())
    }
}
