use serde::{Deserialize, Serialize};

use crate::options_error::{OptionsError, within};

/// Size and rate of the changes of a plant from year to year.
///
/// | field | default | range | meaning |
/// |---|---|---|---|
/// | `strength` | 0 | 0 – 2 | factor on the size of every change: 0 is none, 1 typical of a pilot plant, 2 a plant that is rebuilt |
/// | `membranes_per_year` | 1 | 0 – 50 | mean rate of new membranes |
/// | `feeds_per_year` | 2 | 0 – 50 | mean rate of changes to another feed |
/// | `sensors_per_year` | 0.5 | 0 – 50 | mean rate, per sensor, of being moved, exchanged or calibrated again |
/// | `settings_per_year` | 2 | 0 – 50 | mean rate of changed control settings |
/// | `pumps_per_year` | 1 | 0 – 50 | mean rate of pumps replaced |
///
/// Dates are those of Poisson processes and depend only on the seed and the rate. Sizes depend only on the seed and the
/// strength. Plants of different strengths therefore have the same events, with larger or smaller changes. Sizes, rates
/// and ranges are our choice.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ChangeOptions {
    /// Factor on the size of every change; nothing changes at 0.
    pub strength: f64,
    /// Mean rate of new membranes.
    pub membranes_per_year: f64,
    /// Mean rate of changes to another feed.
    pub feeds_per_year: f64,
    /// Mean rate, per sensor, of being moved, exchanged or calibrated again.
    pub sensors_per_year: f64,
    /// Mean rate of changed control settings.
    pub settings_per_year: f64,
    /// Mean rate of pumps replaced.
    pub pumps_per_year: f64,
}

impl Default for ChangeOptions {
    fn default() -> Self {
        Self {
            strength: 0.0,
            membranes_per_year: 1.0,
            feeds_per_year: 2.0,
            sensors_per_year: 0.5,
            settings_per_year: 2.0,
            pumps_per_year: 1.0,
        }
    }
}

impl ChangeOptions {
    /// Whether these are the defaults, which are omitted when serialised.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// Checks every field against its range.
    ///
    /// # Errors
    /// Names the first field outside its range.
    pub(crate) fn validate(&self) -> Result<(), OptionsError> {
        within("change", self.strength, 0.0..=2.0)?;
        for (field, rate) in [
            ("membranes_per_year", self.membranes_per_year),
            ("feeds_per_year", self.feeds_per_year),
            ("sensors_per_year", self.sensors_per_year),
            ("settings_per_year", self.settings_per_year),
            ("pumps_per_year", self.pumps_per_year),
        ] {
            within(field, rate, 0.0..=50.0)?;
        }
        Ok(())
    }
}
