use std::{collections::BTreeMap, path::Path};

use calib_core::Period;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Paths, TimeRange};
use crate::DataError;

/// `[data]`: where the log is, and which part of it is for what.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DataConfig {
    /// Parquet files: a file, a folder (searched recursively), a glob pattern, or a list of them.
    pub path: Paths,
    /// Only files whose folders say `key=value` like this (hive folders). Default: all.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub partitions: BTreeMap<String, String>,
    /// The column of timestamps. Default: `timestamp`.
    pub timestamp: String,
    /// The unit of timestamps that are plain numbers. Default: told by their magnitude.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub timestamp_unit: Option<TimestampUnit>,
    /// Time from one sample to the next, in seconds. Default: the median of what the log has.
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
    /// The range that stands for the deployment. Default: what follows the training range, if that
    /// is given by `train_fraction`; otherwise none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub held_out: Option<TimeRange>,
    /// Fraction of the time span that is the training range, if `train` is not given. Default: 0.8.
    pub train_fraction: f64,
}

/// The unit of timestamps that are plain numbers since 1970-01-01.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum TimestampUnit {
    /// Seconds.
    #[serde(rename = "s")]
    Seconds,
    /// Milliseconds.
    #[serde(rename = "ms")]
    Milliseconds,
    /// Microseconds.
    #[serde(rename = "us")]
    Microseconds,
    /// Nanoseconds.
    #[serde(rename = "ns")]
    Nanoseconds,
}

impl Default for DataConfig {
    fn default() -> Self {
        Self {
            path: Paths::default(),
            partitions: BTreeMap::new(),
            timestamp: "timestamp".to_owned(),
            timestamp_unit: None,
            period_secs: None,
            gap_tolerance: 1.5,
            include: Vec::new(),
            exclude: Vec::new(),
            train: None,
            held_out: None,
            train_fraction: 0.8,
        }
    }
}

impl DataConfig {
    /// The log at `path`, with every other setting at its default.
    pub fn at(path: impl Into<Paths>) -> Self {
        Self { path: path.into(), ..Self::default() }
    }

    /// Make relative paths relative to `base`, the folder of the study file.
    pub fn resolve(&mut self, base: &Path) {
        self.path.resolve(base);
    }

    /// Check every value on its own.
    ///
    /// # Errors
    /// If a value is outside its range, or two values contradict each other.
    pub fn check(&self) -> Result<(), DataError> {
        let bad = |key: &str, got: String, expected: &'static str| {
            Err(DataError::config(format!("data.{key}"), got, expected))
        };
        if let Some(secs) = self.period_secs
            && Period::from_secs(secs).is_none()
        {
            return bad("period_secs", secs.to_string(), "a positive number");
        }
        if !(self.gap_tolerance > 1.0 && self.gap_tolerance.is_finite()) {
            let got = self.gap_tolerance.to_string();
            return bad("gap_tolerance", got, "a number above 1");
        }
        if !(self.train_fraction > 0.0 && self.train_fraction <= 1.0) {
            let got = self.train_fraction.to_string();
            return bad("train_fraction", got, "a number above 0 and at most 1");
        }
        if self.held_out.is_some() && self.train.is_none() {
            let got = "held_out without train".to_owned();
            return bad("held_out", got, "both ranges, or neither");
        }
        for (key, range) in [("train", &self.train), ("held_out", &self.held_out)] {
            if let Some(TimeRange { start: Some(start), end: Some(end) }) = range
                && start.instant() >= end.instant()
            {
                return bad(key, format!("{start} .. {end}"), "a start before the end");
            }
        }
        Ok(())
    }
}
