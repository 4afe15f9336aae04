use std::{collections::BTreeMap, path::Path};

use calib_core::{Period, Timestamp};
use calib_files::ScratchPlace;
use calib_text::{ParsedTime, TimestampUnit, parse_stamp};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{MaxAge, Moment, Paths, TimeRange};
use crate::{DataError, text::Zone};

/// `[data]`: where the log is, and which part of it is used for what.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DataConfig {
    /// Parquet or text files: a file, a folder (searched recursively), a glob pattern, or a list of them.
    pub path: Paths,
    /// Only files in folders named `key=value` with these keys and values (hive folders). Default: all.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub partitions: BTreeMap<String, String>,
    /// Name of the column of timestamps. Default: `timestamp`.
    pub timestamp: String,
    /// Unit of timestamps that are plain numbers. Default: recognised by their magnitude; if two units fit, this key must decide.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub timestamp_unit: Option<TimestampUnit>,
    /// Format of times that are text, in `strptime` notation: `%d.%m.%Y %H:%M:%S`. Default: recognised from all of them; if the day and the
    /// month could be swapped, this key must decide.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub timestamp_format: Option<String>,
    /// Time zone of times without an offset: `Europe/Paris`. Default: times are kept as recorded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_zone: Option<String>,
    /// The content of one row of the files. Default: recognised by the names and the first rows of the files.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shape: Option<Shape>,
    /// Column with the names of the tags, in a long table. Default: recognised by its name.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tag: Option<String>,
    /// Column of values, in a long table or in files with one tag each. Default: recognised by its name.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub value: Option<String>,
    /// Column of quality codes, in a long table or in files with one tag each. Default: recognised by its name.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quality: Option<String>,
    /// Quality codes of valid values; values with any other code are missing. Default: the good codes of OPC, and words that mean good.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub good_quality: Vec<String>,
    /// Separator of the cells of text files: one character. Default: recognised by the first rows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub separator: Option<char>,
    /// Decimal separator of numbers in text files: `.` or `,`. Default: recognised by the first rows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub decimal: Option<char>,
    /// How lines of text files that cannot be read are treated. Default: the log is refused.
    #[serde(skip_serializing_if = "BadRows::are_errors")]
    #[schemars(extend("default" = "error"))]
    pub bad_rows: BadRows,
    /// Only rows with these values in these columns: `{ turbine = "R80711" }`. Default: all.
    #[serde(
        rename = "where",
        deserialize_with = "values_as_text",
        skip_serializing_if = "BTreeMap::is_empty"
    )]
    pub only: BTreeMap<String, String>,
    /// Whether the names of channels include the name of their file: `kitchen temperature`. Default: false.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    #[schemars(extend("default" = false))]
    pub file_as_prefix: bool,
    /// Numbers that stand for a missing value, such as `[-200, -999.9]`, in all channels. Default: none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub missing_values: Vec<f64>,
    /// Channels that are angles, as names or glob patterns, each with a full turn in its unit: `{ wind_direction = 360.0 }`. The sine and
    /// the cosine replace the channel, as `wind_direction_sin` and `wind_direction_cos`. Default: none.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub angles: BTreeMap<String, f64>,
    /// How rows with the same time and different values of a channel are treated. Default: the log is refused.
    #[serde(skip_serializing_if = "Contradictions::are_refused")]
    #[schemars(extend("default" = "refuse"))]
    pub contradictions: Contradictions,
    /// Resample all channels to common times with a row every `period_secs`, by this method. Default: rows are kept as recorded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub resample: Option<Resample>,
    /// Under `resample`: how long a recorded value is held for the times after it, in seconds. It is a number, or a table by names or glob
    /// patterns of channels, such as `{ default = 60, LAB01 = 86400 }`. Default: ten periods.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_age_secs: Option<MaxAge>,
    /// Time from one sample to the next, in seconds. Default: the median of the log.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub period_secs: Option<f64>,
    /// A step longer than this many periods is a gap. Default: 1.5.
    pub gap_tolerance: f64,
    /// Channels to use, as names or glob patterns. Default: all.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub include: Vec<String>,
    /// Channels to leave out, as names or glob patterns. Default: none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub exclude: Vec<String>,
    /// The training range. Default: the first `train_fraction` of the time span.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub train: Option<TimeRange>,
    /// The range that represents the deployment. Default: all that follows the training range, if `train_fraction` defines that range;
    /// otherwise none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub held_out: Option<TimeRange>,
    /// Fraction of the time span that is the training range, if `train` is not given. Default: 0.8.
    pub train_fraction: f64,
    /// Where text files and long tables are kept, column by column, while they are read.
    #[serde(skip)]
    pub scratch: ScratchPlace,
    /// Available memory, in bytes; data that would need more is refused. `None` if it is unknown.
    #[serde(skip)]
    pub memory: Option<u64>,
}

/// Reads values as text; numbers become the texts that the files have.
fn values_as_text<'de, D>(deserializer: D) -> Result<BTreeMap<String, String>, D::Error>
where
    D: serde::Deserializer<'de>,
{
    #[derive(Deserialize)]
    #[serde(untagged, expecting = "expected a text or a whole number")]
    enum Written {
        Text(String),
        Number(i64),
    }
    let written = BTreeMap::<String, Written>::deserialize(deserializer)?;
    Ok(written
        .into_iter()
        .map(|(column, value)| match value {
            Written::Text(text) => (column, text),
            Written::Number(number) => (column, number.to_string()),
        })
        .collect())
}

/// The content of one row of the files of a log.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// A time and a value of every channel: one column per channel.
    #[default]
    Wide,
    /// A time, a tag and its value.
    Long,
    /// A time and the value of the file's only tag.
    FilePerTag,
}

impl Shape {
    /// Whether the shape is [`Shape::Wide`].
    pub fn is_wide(&self) -> bool {
        *self == Self::Wide
    }
}

/// How rows with the same time and different values of a channel are treated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Contradictions {
    /// The log is refused.
    #[default]
    Refuse,
    /// The first value is kept: the one in the file that starts first, and within a file the first.
    First,
    /// The last value is kept.
    Last,
    /// The rows of a wide file that share a time are spread evenly from this time up to the next one: the export had cut times to whole
    /// minutes or hours. Values that still contradict each other are refused.
    Spread,
}

/// How lines of text files that cannot be read are treated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BadRows {
    /// The log is refused, with a count of all such lines.
    #[default]
    Error,
    /// They are skipped and counted, if they are at most one line in a hundred.
    Skip,
}

impl BadRows {
    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde wants a reference")]
    fn are_errors(&self) -> bool {
        *self == Self::Error
    }
}

impl Contradictions {
    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde wants a reference")]
    fn are_refused(&self) -> bool {
        *self == Self::Refuse
    }

    /// Whether contradicting values are an error.
    pub fn refuses(self) -> bool {
        matches!(self, Self::Refuse | Self::Spread)
    }
}

/// How a channel that was recorded at other times is resampled to the common times of the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Resample {
    /// The last recorded value.
    Last,
    /// The time-weighted mean of the last recorded value, over the period that ends at the row.
    Mean,
    /// Linear interpolation between the values before and after, although an agent at the plant does not have the later one yet.
    Linear,
}

impl Default for DataConfig {
    fn default() -> Self {
        Self {
            path: Paths::default(),
            partitions: BTreeMap::new(),
            timestamp: "timestamp".to_owned(),
            timestamp_unit: None,
            timestamp_format: None,
            time_zone: None,
            shape: None,
            tag: None,
            value: None,
            quality: None,
            good_quality: Vec::new(),
            separator: None,
            decimal: None,
            bad_rows: BadRows::Error,
            only: BTreeMap::new(),
            file_as_prefix: false,
            missing_values: Vec::new(),
            angles: BTreeMap::new(),
            contradictions: Contradictions::Refuse,
            resample: None,
            max_age_secs: None,
            period_secs: None,
            gap_tolerance: 1.5,
            include: Vec::new(),
            exclude: Vec::new(),
            train: None,
            held_out: None,
            train_fraction: 0.8,
            scratch: ScratchPlace::Memory,
            memory: None,
        }
    }
}

impl DataConfig {
    /// Returns the configuration of the log at `path`, with all other keys at their defaults.
    pub fn at(path: impl Into<Paths>) -> Self {
        Self { path: path.into(), ..Self::default() }
    }

    /// Whether a part of the log is held out. A very short log has no such part all the same.
    pub fn holds_out(&self) -> bool {
        self.held_out.is_some() || (self.train.is_none() && self.train_fraction < 1.0)
    }

    /// Makes relative paths relative to `base`, the folder of the study file.
    pub fn resolve(&mut self, base: &Path) {
        self.path.resolve(base);
    }

    /// Checks every key on its own.
    ///
    /// # Errors
    /// If a value is outside its range, or two values contradict each other.
    pub fn check(&self) -> Result<(), DataError> {
        if let Some(secs) = self.period_secs
            && Period::from_secs(secs).is_none()
        {
            return refuse("period_secs", secs.to_string(), "a positive number");
        }
        self.check_text()?;
        if let Some((name, turn)) =
            self.angles.iter().find(|(_, turn)| !(**turn > 0.0 && turn.is_finite()))
        {
            let expected = "a positive number: a full turn in the unit of the channel, such as 360 for degrees";
            return refuse(&format!("angles.{name}"), turn.to_string(), expected);
        }
        if self.resample.is_some() && self.period_secs.is_none() {
            let got = "resample without period_secs".to_owned();
            return refuse(
                "resample",
                got,
                "data.period_secs as well: the time from one row to the next",
            );
        }
        for (key, secs) in self.max_age_secs.iter().flat_map(MaxAge::keys) {
            if Period::from_secs(secs).is_none() {
                return refuse(&key, secs.to_string(), "a number of seconds above 0");
            }
            if self.resample.is_none() {
                return refuse(&key, secs.to_string(), "data.resample as well");
            }
        }
        if !(self.gap_tolerance > 1.0 && self.gap_tolerance.is_finite()) {
            let got = self.gap_tolerance.to_string();
            return refuse("gap_tolerance", got, "a number above 1");
        }
        if !(self.train_fraction > 0.0 && self.train_fraction <= 1.0) {
            let got = self.train_fraction.to_string();
            return refuse("train_fraction", got, "a number above 0 and at most 1");
        }
        if self.held_out.is_some() && self.train.is_none() {
            return Err(DataError::HeldOutWithoutTrain);
        }
        for (key, range) in [("train", &self.train), ("held_out", &self.held_out)] {
            if let Some(TimeRange { start: Some(start), end: Some(end) }) = range
                && start.instant() >= end.instant()
            {
                return refuse(key, format!("{start} .. {end}"), "a start before the end");
            }
        }
        Ok(())
    }

    fn check_text(&self) -> Result<(), DataError> {
        if let Some(separator) = self.separator
            && (!separator.is_ascii()
                || separator.is_ascii_alphanumeric()
                || "\"\r\n".contains(separator))
        {
            return refuse(
                "separator",
                format!("{separator:?}"),
                "one sign such as \",\", \";\" or \"\\t\"",
            );
        }
        if let Some(decimal) = self.decimal
            && (!".,".contains(decimal) || self.separator == Some(decimal))
        {
            return refuse(
                "decimal",
                format!("{decimal:?}"),
                "\".\" or \",\", and not the separator",
            );
        }
        if let Some(zone) = &self.time_zone
            && Zone::new(zone).is_none()
        {
            return refuse(
                "time_zone",
                format!("{zone:?}"),
                "the name of a time zone such as \"Europe/Paris\" or \"UTC\"",
            );
        }
        Ok(())
    }

    /// Returns the instant of `moment` on the clock of the log.
    pub fn instant(&self, moment: &Moment) -> Timestamp {
        match (parse_stamp(&moment.to_string()), self.time_zone.as_deref().and_then(Zone::new)) {
            (Some(ParsedTime::Wall(wall)), Some(zone)) => {
                zone.moment(wall).map_or(moment.instant(), Timestamp::from_micros)
            }
            _ => moment.instant(),
        }
    }

    /// Returns the same range, with its moments on the clock of the log.
    #[must_use]
    pub fn on_its_clock(&self, range: &TimeRange) -> TimeRange {
        let [start, end] = [&range.start, &range.end]
            .map(|at| at.as_ref().map(|at| at.moved_to(self.instant(at))));
        TimeRange { start, end }
    }

    /// Returns how long a recorded value stays valid in a channel without an entry of its own, in microseconds.
    pub(crate) fn max_age(&self, period: Period) -> i64 {
        let given = self.max_age_secs.as_ref().and_then(MaxAge::default_secs);
        let given = given.and_then(Period::from_secs);
        given.map_or(period.as_micros().saturating_mul(PERIODS_OF_AGE), Period::as_micros)
    }
}

/// Returns an error with the value of a key in `[data]` and the values that it may have.
fn refuse(key: &str, got: String, expected: &'static str) -> Result<(), DataError> {
    Err(DataError::config(format!("data.{key}"), got, expected))
}

/// Default number of periods for which a recorded value stays valid.
const PERIODS_OF_AGE: i64 = 10;

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<DataConfig, toml::de::Error> {
        toml::from_str(text)
    }

    #[test]
    fn a_value_of_where_may_be_written_as_a_number() {
        let data = read(r#"where = { PLANT_ID = 4135001, room = "A" }"#).expect("read");
        assert_eq!(data.only["PLANT_ID"], "4135001");
        assert_eq!(data.only["room"], "A");
        let error = read("where = { PLANT_ID = 0.5 }").expect_err("no text");
        assert!(error.to_string().contains("expected a text or a whole number"), "{error}");
    }
}
