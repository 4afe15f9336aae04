use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::DataError;

/// `[preprocess]`: from the channels of the log to the columns of the states.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PreprocessConfig {
    /// A channel that misses more than this fraction of the training range is dropped. Default: 0.1.
    pub max_missing: f64,
    /// How the remaining missing values are treated. Default: `forward_fill`.
    pub missing: Missing,
    /// Longest run of missing values that is filled, in rows of the log. Default: 10.
    pub fill_limit: usize,
    /// How spikes, single samples far outside all other values, are treated. Default: `missing`.
    #[serde(skip_serializing_if = "Outliers::is_default")]
    #[schemars(extend("default" = "missing"))]
    pub outliers: Outliers,
    /// How values are scaled; fitted on the recorded values of the training range. Default: `min_max`.
    pub normalise: Normalisation,
    /// The two quantiles that map to 0 and 1 under `quantile`. Default: 0 and 1.
    pub quantiles: [f64; 2],
    /// Clip normalised values to `[0, 1]`. Not for `standard`. Default: false.
    pub clip: bool,
    /// Add the sine and cosine of the time of day. Default: false.
    pub time_of_day: bool,
    /// Add an exponential trace of every sensor for each of these decay rates. Default: none.
    pub traces: Vec<f64>,
    /// Replace this column of modes by one 0/1 column per value of the training range. Default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub one_hot: Option<String>,
    /// Keep one row in N, where N is this number. Default: 1, every row.
    pub subsample: usize,
    /// How a group of N rows becomes the kept row. Default: `keep`.
    pub reduce: Reduce,
}

/// How missing values that remain after column selection are treated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Missing {
    /// The row is dropped, which splits the segment.
    DropRow,
    /// The last recorded value replaces the first `fill_limit` missing values of a run; the rows after them are dropped.
    #[default]
    ForwardFill,
    /// Runs of at most `fill_limit` rows are interpolated in time between their ends, although an agent at the plant
    /// does not have the later end yet. The rows of longer runs are dropped.
    Linear,
}

/// How spikes are treated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Outliers {
    /// They are kept.
    Keep,
    /// They become missing values.
    #[default]
    Missing,
    /// They become the nearest value inside the fences.
    Clip,
}

impl Outliers {
    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde wants a reference")]
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// How the values of a sensor map to the scale of the states.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Normalisation {
    /// Minimum to 0, maximum to 1.
    #[default]
    MinMax,
    /// Two quantiles to 0 and 1.
    Quantile,
    /// Mean to 0, standard deviation to 1.
    Standard,
}

/// How a group of rows becomes one row of the sub-sampled log.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Reduce {
    /// The first row of the group.
    #[default]
    Keep,
    /// The mean of the group, at the time of its last row; an incomplete last group is dropped.
    Mean,
}

impl Default for PreprocessConfig {
    fn default() -> Self {
        Self {
            max_missing: 0.1,
            missing: Missing::default(),
            fill_limit: 10,
            outliers: Outliers::default(),
            normalise: Normalisation::default(),
            quantiles: [0.0, 1.0],
            clip: false,
            time_of_day: false,
            traces: Vec::new(),
            one_hot: None,
            subsample: 1,
            reduce: Reduce::default(),
        }
    }
}

impl PreprocessConfig {
    /// Checks every key on its own.
    ///
    /// # Errors
    /// If a value is outside its range, or two values contradict each other.
    pub fn check(&self) -> Result<(), DataError> {
        if !(0.0..=1.0).contains(&self.max_missing) {
            let got = self.max_missing.to_string();
            return refuse("max_missing", got, "a fraction from 0 to 1");
        }
        let [low, high] = self.quantiles;
        if !(0.0 <= low && low < high && high <= 1.0) {
            let got = format!("[{low}, {high}]");
            return refuse("quantiles", got, "two increasing fractions from 0 to 1");
        }
        if self.clip && self.normalise == Normalisation::Standard {
            let expected = "false with normalise = \"standard\", which has no ends to clip to";
            return refuse("clip", "true".to_owned(), expected);
        }
        if let Some(decay) = self.traces.iter().find(|decay| !(0.0..1.0).contains(*decay)) {
            return refuse("traces", decay.to_string(), "decay rates from 0 to below 1");
        }
        if self.subsample == 0 {
            return refuse("subsample", "0".to_owned(), "a whole number of at least 1");
        }
        Ok(())
    }
}

/// Returns an error with the value of a key in `[preprocess]` and the values that it may have.
fn refuse(key: &str, got: String, expected: &'static str) -> Result<(), DataError> {
    Err(DataError::config(format!("preprocess.{key}"), got, expected))
}
