use calib_core::{Period, Seed};
use calib_data::Moment;
use calib_plant::{ChangeOptions, PlantOptions};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{StudyError, error::Problem};

/// The `[simulate]` section: the plant that the log of the study is simulated from, and the options of
/// `calib simulate`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SimulateConfig {
    /// Number of days to simulate; the last may be a fraction of a day (default 7).
    pub days: f64,
    /// Number of sensor channels (default 480, as in the paper).
    pub channels: usize,
    /// Seconds between samples (default 1).
    pub period_secs: f64,
    /// First day (default 2022-11-01).
    pub start: Moment,
    /// Seed of all random numbers of the plant (default 0).
    pub seed: u64,
    /// Factor on the slow drift of the instruments (default 1).
    pub drift: f64,
    /// Factor on the white noise of the instruments (default 1).
    pub noise: f64,
    /// Mean rate of turbidity bursts (default 6).
    pub storms_per_day: f64,
    /// Expected fraction of missing values of a healthy channel (default 0.001).
    pub missing_fraction: f64,
    /// Mean rate of outages of the whole historian (default 0.5).
    pub gaps_per_day: f64,
    /// Mean rate, per channel, of periods with a frozen value (default 0.02).
    pub stuck_per_day: f64,
    /// Mean rate of rows written twice (default 0).
    pub duplicates_per_day: f64,
    /// Factor on the size of changes from year to year (default 0: no change).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub change: Option<f64>,
    /// Mean rate of membrane replacements (default 1).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub membranes_per_year: Option<f64>,
    /// Mean rate of changes of the feed (default 2).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub feeds_per_year: Option<f64>,
    /// Mean rate, per sensor, of moves, replacements or recalibrations (default 0.5).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensors_per_year: Option<f64>,
    /// Mean rate of changes of the control settings (default 2).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub settings_per_year: Option<f64>,
    /// Mean rate of pump replacements (default 1).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pumps_per_year: Option<f64>,
}

impl Default for SimulateConfig {
    fn default() -> Self {
        Self {
            days: 7.0,
            channels: 480,
            period_secs: 1.0,
            start: Moment::new("2022-11-01").expect("a date"),
            seed: 0,
            drift: 1.0,
            noise: 1.0,
            storms_per_day: 6.0,
            missing_fraction: 0.001,
            gaps_per_day: 0.5,
            stuck_per_day: 0.02,
            duplicates_per_day: 0.0,
            change: None,
            membranes_per_year: None,
            feeds_per_year: None,
            sensors_per_year: None,
            settings_per_year: None,
            pumps_per_year: None,
        }
    }
}

impl SimulateConfig {
    /// Returns the options of the simulated plant.
    ///
    /// # Errors
    /// If a value is outside its range.
    pub fn plant(&self) -> Result<PlantOptions, StudyError> {
        let period = Period::from_secs(self.period_secs).ok_or_else(|| {
            let got = self.period_secs;
            StudyError::Value(format!(
                "`period_secs` must be a positive number of seconds, got {got}"
            ))
        })?;
        let options = PlantOptions {
            channels: self.channels,
            days: self.days,
            period,
            start: self.start.instant(),
            seed: Seed::new(self.seed),
            drift: self.drift,
            noise: self.noise,
            storms_per_day: self.storms_per_day,
            missing_fraction: self.missing_fraction,
            gaps_per_day: self.gaps_per_day,
            stuck_per_day: self.stuck_per_day,
            duplicates_per_day: self.duplicates_per_day,
            change: self.changes(),
        };
        options.validate().map_err(Problem::from)?;
        Ok(options)
    }

    fn changes(&self) -> ChangeOptions {
        let usual = ChangeOptions::default();
        ChangeOptions {
            strength: self.change.unwrap_or(usual.strength),
            membranes_per_year: self.membranes_per_year.unwrap_or(usual.membranes_per_year),
            feeds_per_year: self.feeds_per_year.unwrap_or(usual.feeds_per_year),
            sensors_per_year: self.sensors_per_year.unwrap_or(usual.sensors_per_year),
            settings_per_year: self.settings_per_year.unwrap_or(usual.settings_per_year),
            pumps_per_year: self.pumps_per_year.unwrap_or(usual.pumps_per_year),
        }
    }
}
