use calib_core::Seed;
use serde::{Deserialize, Serialize};

use crate::signal::{Nature, Signal};

/// The decision that preprocessing should make about a channel, given a day or more and at least
/// 1,000 rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fate {
    /// Varies, and at most 8 % of its values are missing: kept.
    Alive,
    /// One value only: dropped as constant.
    Constant,
    /// More than 30 % of its values are missing, perhaps all: dropped as missing.
    Missing,
}

/// The ground truth about one channel.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChannelInfo {
    /// Name of the column, unique in the plant.
    pub name: String,
    /// Unit of the values; empty for switches and numbers.
    pub unit: String,
    /// The measured quantity, in a few words.
    pub description: String,
    /// The expected decision of preprocessing.
    pub fate: Fate,
}

/// A channel: its value, and the errors that its instrument and the historian add.
#[derive(Clone, Debug)]
pub(crate) struct Channel {
    pub(crate) info: ChannelInfo,
    pub(crate) recipe: Recipe,
    pub(crate) instrument: Instrument,
    pub(crate) availability: Availability,
}

impl Channel {
    /// Whether the channel is made from this signal, and is recorded at all.
    pub(crate) fn shows(&self, signal: Signal) -> bool {
        let made_from = match self.recipe {
            Recipe::Lagged { signal: source, .. } | Recipe::Filtered { signal: source, .. } => {
                source == signal
            }
            Recipe::Sum(a, b) | Recipe::Difference(a, b) | Recipe::Ratio(a, b, _) => {
                a == signal || b == signal
            }
            Recipe::Constant(_) => false,
        };
        made_from && self.availability != Availability::Never
    }
}

/// The value of a channel before any instrument error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Recipe {
    /// A signal as it was `lag_secs` ago.
    Lagged { signal: Signal, lag_secs: f64 },
    /// A signal after a first-order filter.
    Filtered { signal: Signal, tau_secs: f64 },
    /// a + b.
    Sum(Signal, Signal),
    /// a − b.
    Difference(Signal, Signal),
    /// a / b, and 0 where b is below the last number.
    Ratio(Signal, Signal, f32),
    /// A constant value.
    Constant(f32),
}

/// The times at which a channel is recorded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Availability {
    /// Always, except during outages of its input card.
    Always,
    /// In the first `share` of every `cycle_secs`, from `phase_secs` on: a scheduled analyser.
    Scheduled { cycle_secs: f64, phase_secs: f64, share: f64 },
    /// Never: a retired instrument that the historian still lists.
    Never,
}

/// Errors of an instrument and of the historian after it, in the unit of the channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Instrument {
    /// Shows the value without error.
    Exact,
    /// Has a range, white noise, drift, quantisation and a dead-band. The value may freeze.
    Analog {
        range: (f64, f64),
        /// Standard deviation of the white noise.
        noise: f64,
        /// Amplitude of the slow drift.
        drift: f64,
        /// Step of the converter.
        resolution: f64,
        /// Changes up to this size are not recorded.
        dead_band: f64,
    },
}

/// Converters have 14 bits.
const CONVERTER_STEPS: f64 = 16_384.0;
/// Drift of a default plant, as a share of the range.
const DRIFT_SHARE: f64 = 0.004;
/// Dead-bands in use, as shares of the range. The three roles have no dead-band.
const DEAD_BANDS: [f64; 4] = [0.0, 0.0005, 0.001, 0.0025];

impl Instrument {
    /// Returns the instrument for a quantity of this nature and range.
    pub(crate) fn new(name: &str, nature: Nature, range: (f64, f64)) -> Self {
        let Nature::Analog(noise) = nature else {
            return Self::Exact;
        };
        let span = range.1 - range.0;
        let is_role = crate::ROLES.contains(&name);
        let pick = (name_number(name) % DEAD_BANDS.len() as u64) as usize;
        Self::Analog {
            range,
            noise: noise * span,
            drift: DRIFT_SHARE * span,
            resolution: span / CONVERTER_STEPS,
            dead_band: if is_role { 0.0 } else { DEAD_BANDS[pick] * span },
        }
    }
}

/// Returns a number that depends only on the name, so that properties of a channel do not depend on
/// other channels.
pub(crate) fn name_number(name: &str) -> u64 {
    Seed::new(0).child("channel").child(name).get()
}
