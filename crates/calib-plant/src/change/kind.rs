use std::fmt;

use calib_core::Timestamp;
use schemars::JsonSchema;
use serde::Serialize;

/// A change of the plant, with its date.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Change {
    /// The date. Membranes and pumps are exchanged when the plant next stops, within hours.
    pub at: Timestamp,
    /// The change itself.
    #[serde(flatten)]
    pub kind: ChangeKind,
}

/// A change of the plant, and the state from then on. Factors and offsets are relative to the initial plant.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum ChangeKind {
    /// New membranes.
    Membranes(Membranes),
    /// Another feed.
    Feed(Feed),
    /// A sensor that was moved, replaced or recalibrated.
    Sensor {
        /// Tag of the sensor.
        tag: String,
        /// Its readings from then on.
        #[serde(flatten)]
        sensor: Sensor,
    },
    /// Other control settings.
    Settings(Settings),
    /// A new pump.
    Pump(Pump),
}

/// Properties of the membranes when new.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Membranes {
    /// Factor on the resistance of the clean membrane, the inverse of the factor on its permeability.
    pub resistance: f64,
    /// Factor on the rates at which cake and pores build up.
    pub fouling: f64,
}

/// Properties of the feed water.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Feed {
    /// Days over which it is blended in.
    pub blending_days: f64,
    /// Offset of the temperature, °C.
    pub temperature_offset: f64,
    /// Factor on the seasonal amplitude of the temperature.
    pub season: f64,
    /// Days by which the season is delayed.
    pub season_delay_days: f64,
    /// Factor on the mean turbidity in calm periods.
    pub turbidity: f64,
    /// Factor on the spread of the turbidity in storms.
    pub storms: f64,
    /// Offset of the conductivity, µS/cm.
    pub conductivity_offset: f64,
    /// Offset of the pH.
    pub acidity_offset: f64,
    /// Factor on organic matter (TOC), which also affects fouling and the dose of hypochlorite.
    pub organics: f64,
}

/// Response of a sensor to the true value x: it follows `gain · x + offset` with a time constant.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Sensor {
    /// Offset, in the unit of the sensor.
    pub offset: f64,
    /// Gain.
    pub gain: f64,
    /// Time constant, s.
    pub time_constant_secs: f64,
    /// Factor on the white noise.
    pub noise: f64,
}

/// Control settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Settings {
    /// Factor on the production target.
    pub production: f64,
    /// Factor on the production time between back-pulses.
    pub back_pulse_interval: f64,
}

/// Duty of a pump.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PumpDuty {
    /// It draws permeate through the membrane.
    Permeate,
    /// It feeds the membrane tank.
    Feed,
}

/// A pump.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Pump {
    /// The duty of the pump.
    pub duty: PumpDuty,
    /// Factor on the speed that the same flow requires.
    pub speed: f64,
    /// Factor on the pulsation: of the membrane pressure, or of the feed flow.
    pub pulsation: f64,
    /// Factor on the response time to its set-point.
    pub response: f64,
}

impl Feed {
    /// The initial feed of the plant.
    pub(crate) const FIRST: Self = Self {
        blending_days: 0.0,
        temperature_offset: 0.0,
        season: 1.0,
        season_delay_days: 0.0,
        turbidity: 1.0,
        storms: 1.0,
        conductivity_offset: 0.0,
        acidity_offset: 0.0,
        organics: 1.0,
    };

    /// Returns the feed that is `share` of the way to `other`, field by field.
    pub(crate) fn blended(&self, other: &Self, share: f64) -> Self {
        let blend = |field: fn(&Self) -> f64| field(self) + share * (field(other) - field(self));
        Self {
            blending_days: other.blending_days,
            temperature_offset: blend(|feed| feed.temperature_offset),
            season: blend(|feed| feed.season),
            season_delay_days: blend(|feed| feed.season_delay_days),
            turbidity: blend(|feed| feed.turbidity),
            storms: blend(|feed| feed.storms),
            conductivity_offset: blend(|feed| feed.conductivity_offset),
            acidity_offset: blend(|feed| feed.acidity_offset),
            organics: blend(|feed| feed.organics),
        }
    }
}

impl Pump {
    /// Returns the initial pump of the plant.
    pub(crate) const fn first(duty: PumpDuty) -> Self {
        Self { duty, speed: 1.0, pulsation: 1.0, response: 1.0 }
    }
}

impl fmt::Display for ChangeKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Membranes(Membranes { resistance, fouling }) => {
                write!(f, "new membranes: resistance × {resistance:.2}, fouling × {fouling:.2}")
            }
            Self::Feed(feed) => feed.fmt(f),
            Self::Sensor { tag, sensor } => {
                let Sensor { offset, gain, time_constant_secs, noise } = sensor;
                write!(
                    f,
                    "{tag}: reads {gain:.3} x {offset:+.3}, behind {time_constant_secs:.0} s, noise × {noise:.2}"
                )
            }
            Self::Settings(Settings { production, back_pulse_interval }) => write!(
                f,
                "settings: production × {production:.2}, back-pulse interval × {back_pulse_interval:.2}"
            ),
            Self::Pump(Pump { duty, speed, pulsation, response }) => {
                let duty = match duty {
                    PumpDuty::Permeate => "permeate",
                    PumpDuty::Feed => "feed",
                };
                write!(
                    f,
                    "new {duty} pump: speed × {speed:.2}, pulsation × {pulsation:.2}, response × {response:.2}"
                )
            }
        }
    }
}

impl fmt::Display for Feed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "another feed over {:.1} d: {:+.1} °C, season × {:.2} and {:+.0} d, turbidity × {:.2}, \
             storms × {:.2}, {:+.0} µS/cm, pH {:+.2}, organics × {:.2}",
            self.blending_days,
            self.temperature_offset,
            self.season,
            self.season_delay_days,
            self.turbidity,
            self.storms,
            self.conductivity_offset,
            self.acidity_offset,
            self.organics
        )
    }
}
