use calib_core::{Period, Seed, Timestamp};
use serde::{Deserialize, Serialize};

use crate::{
    ChangeOptions,
    options_error::{OptionsError, within},
};

/// The plant to simulate, the length of its log, and the faults of its instruments and historian.
///
/// | field | default | range | meaning |
/// |---|---|---|---|
/// | `channels` | 24 | 3 – 10,000 | columns of the log; the paper's plant has 480 |
/// | `days` | 2 | 0 < d ≤ 36,525 | length; the last day may be a part of one |
/// | `period` | 1 s | 0.1 s – 1 h | time between rows |
/// | `start` | 2022-11-01 | | wall-clock time of the first row |
/// | `seed` | 0 | | everything random follows from it |
/// | `drift` | 1 | 0 – 100 | factor on the slow drift of the instruments |
/// | `noise` | 1 | 0 – 100 | factor on the white noise of the instruments |
/// | `storms_per_day` | 6 | 0 – 200 | mean rate of turbidity bursts |
/// | `missing_fraction` | 0.0005 | 0 – 0.05 | expected share of missing values of a healthy channel |
/// | `gaps_per_day` | 0.5 | 0 – 24 | mean rate of outages of the whole historian (absent rows) |
/// | `stuck_per_day` | 0.02 | 0 – 10 | mean rate, per channel, of periods with a frozen value |
/// | `duplicates_per_day` | 0 | 0 – 1,000 | mean rate of rows written twice |
/// | `change` | none | [`ChangeOptions`] | changes from year to year |
///
/// Rates and durations are in seconds and days, never in rows. Another `period` samples the same
/// plant, with the same schedule of modes and the same storms, at other instants.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PlantOptions {
    /// Columns of the log.
    pub channels: usize,
    /// Days to simulate.
    pub days: f64,
    /// Time between rows.
    pub period: Period,
    /// Wall-clock time of the first row. It sets the time of day and of the year.
    pub start: Timestamp,
    /// Seed of everything random.
    pub seed: Seed,
    /// Factor on the slow drift of the instruments.
    pub drift: f64,
    /// Factor on the white noise of the instruments.
    pub noise: f64,
    /// Mean rate of turbidity bursts.
    pub storms_per_day: f64,
    /// Expected share of missing values of a healthy channel.
    pub missing_fraction: f64,
    /// Mean rate of outages of the whole historian.
    pub gaps_per_day: f64,
    /// Mean rate, per channel, of periods with a frozen value.
    pub stuck_per_day: f64,
    /// Mean rate of rows written twice.
    pub duplicates_per_day: f64,
    /// Changes from year to year. The default, no change, is omitted when serialised.
    #[serde(skip_serializing_if = "ChangeOptions::is_default")]
    pub change: ChangeOptions,
}

/// 2022-11-01T00:00:00.
const NOVEMBER_2022: Timestamp = Timestamp::from_micros(1_667_260_800_000_000);

impl Default for PlantOptions {
    fn default() -> Self {
        Self {
            channels: 24,
            days: 2.0,
            period: Period::from_micros(1_000_000).expect("a second is positive"),
            start: NOVEMBER_2022,
            seed: Seed::new(0),
            drift: 1.0,
            noise: 1.0,
            storms_per_day: 6.0,
            missing_fraction: 0.0005,
            gaps_per_day: 0.5,
            stuck_per_day: 0.02,
            duplicates_per_day: 0.0,
            change: ChangeOptions::default(),
        }
    }
}

impl PlantOptions {
    /// Minimum number of channels: the three sensors that the paper predicts.
    pub const MIN_CHANNELS: usize = 3;
    /// Maximum number of channels.
    pub const MAX_CHANNELS: usize = 10_000;

    /// Checks every field against its range.
    ///
    /// # Errors
    /// Names the first field outside its range, with the value and the range.
    pub fn validate(&self) -> Result<(), OptionsError> {
        let channels = Self::MIN_CHANNELS as f64..=Self::MAX_CHANNELS as f64;
        within("channels", self.channels as f64, channels)?;
        within("days", self.days, f64::MIN_POSITIVE..=36_525.0)?;
        within("period_secs", self.period.as_secs(), 0.1..=3600.0)?;
        within("drift", self.drift, 0.0..=100.0)?;
        within("noise", self.noise, 0.0..=100.0)?;
        within("storms_per_day", self.storms_per_day, 0.0..=200.0)?;
        within("missing_fraction", self.missing_fraction, 0.0..=0.05)?;
        within("gaps_per_day", self.gaps_per_day, 0.0..=24.0)?;
        within("stuck_per_day", self.stuck_per_day, 0.0..=10.0)?;
        within("duplicates_per_day", self.duplicates_per_day, 0.0..=1000.0)?;
        self.change.validate()?;
        let years = self.start.as_micros() as f64 / 1e6 / SECONDS_PER_YEAR;
        if years < -70.0 || years + self.days / 365.2425 > 230.0 {
            return Err(OptionsError::Calendar { start_micros: self.start.as_micros() });
        }
        Ok(())
    }

    /// Returns the number of rows of the whole log before gaps and duplicates:
    /// instants `start + k · period` within `days`.
    pub(crate) fn instants(&self) -> i64 {
        (self.days * SECONDS_PER_DAY * 1e6 / self.period.as_micros() as f64).ceil().max(1.0) as i64
    }

    /// Returns the first instant of day `day`, counted from the start.
    pub(crate) fn first_instant(&self, day: u32) -> i64 {
        let micros = i64::from(day) * MICROS_PER_DAY;
        let period = self.period.as_micros();
        ((micros + period - 1) / period).min(self.instants())
    }
}

pub(crate) const SECONDS_PER_DAY: f64 = 86_400.0;
pub(crate) const SECONDS_PER_YEAR: f64 = 365.2425 * SECONDS_PER_DAY;
const MICROS_PER_DAY: i64 = 86_400_000_000;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_within_their_ranges() {
        assert_eq!(PlantOptions::default().validate(), Ok(()));
    }

    fn message(change: fn(&mut PlantOptions)) -> String {
        let mut options = PlantOptions::default();
        change(&mut options);
        options.validate().expect_err("out of range").to_string()
    }

    #[test]
    fn an_option_out_of_range_is_named() {
        assert_eq!(
            message(|o| o.channels = 2),
            "`channels` is 2, expected a number from 3 to 10000"
        );
        assert_eq!(
            message(|o| o.days = 0.0),
            "`days` is 0, expected a number above 0 and up to 36525"
        );
        assert!(message(|o| o.noise = f64::NAN).starts_with("`noise` is NaN"));
        assert!(message(|o| o.missing_fraction = 0.2).contains("from 0 to 0.05"));
        assert!(message(|o| o.period = Period::from_micros(1).unwrap()).contains("`period_secs`"));
        assert!(
            message(|o| o.change.strength = 3.0)
                .starts_with("`change` is 3, expected a number from 0 to 2")
        );
        assert!(message(|o| o.noise = -1e300).starts_with("`noise` is -1e300, expected"));
        assert!(message(|o| o.change.pumps_per_year = -1.0).contains("pumps_per_year"));
        assert!(message(|o| o.start = Timestamp::from_micros(i64::MAX)).contains("1900"));
    }

    #[test]
    fn days_share_out_the_instants() {
        let options = PlantOptions {
            days: 1.5,
            period: Period::from_secs(7.0).unwrap(),
            ..PlantOptions::default()
        };
        // 86,400 / 7 is not whole: the second day begins at the first multiple of 7 after midnight.
        assert_eq!(options.first_instant(0), 0);
        assert_eq!(options.first_instant(1), 12_343);
        assert_eq!(options.first_instant(2), 18_515);
        assert_eq!(options.instants(), 18_515);
    }

    #[test]
    fn options_are_read_from_text() {
        let read: PlantOptions = toml::from_str("channels = 64\ndays = 3\nseed = 9").unwrap();
        assert_eq!((read.channels, read.days, read.seed), (64, 3.0, Seed::new(9)));
        assert_eq!(read.noise, 1.0);
        assert!(toml::from_str::<PlantOptions>("chanels = 64").is_err());
        let text = toml::to_string(&read).unwrap();
        assert_eq!(toml::from_str::<PlantOptions>(&text).unwrap(), read);
        assert!(
            !text.contains("change"),
            "what was written before there were changes is the same text"
        );
        let changing: PlantOptions = toml::from_str("change = { strength = 1.5 }").unwrap();
        assert_eq!((changing.change.strength, changing.change.feeds_per_year), (1.5, 2.0));
        let text = toml::to_string(&changing).unwrap();
        assert_eq!(toml::from_str::<PlantOptions>(&text).unwrap(), changing);
    }
}
