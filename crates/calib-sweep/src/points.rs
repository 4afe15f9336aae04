//! The values of an axis: a list, or every number between two ends.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// The values of an axis, prepared for enumeration and for random draws.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Points {
    /// A list of values, each equally likely.
    Discrete(Vec<Value>),
    /// Every number of a range.
    Continuous(Interval),
}

impl Points {
    /// Maps a uniform draw from `[0, 1)` to a value, and returns it with its place in grid order.
    pub(crate) fn draw(&self, unit: f64) -> (f64, Value) {
        match self {
            Self::Discrete(values) => {
                let place = ((unit * values.len() as f64) as usize).min(values.len() - 1);
                (place as f64, values[place].clone())
            }
            Self::Continuous(interval) => {
                let value = interval.draw(unit);
                (value, interval.value(value))
            }
        }
    }
}

/// The spacing of numbers in a range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Scale {
    /// Equal differences.
    Linear,
    /// Equal ratios.
    Log,
}

/// Every number between two ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Interval {
    pub(crate) from: f64,
    pub(crate) to: f64,
    pub(crate) scale: Scale,
    pub(crate) whole: bool,
}

impl Interval {
    pub(crate) fn check(&self) -> Result<(), String> {
        let Self { from, to, scale, whole } = *self;
        if !(from.is_finite() && to.is_finite() && from < to) {
            let [from, to] = [from, to].map(|end| crate::written(&Value::from(end)));
            return Err(format!("from must be below to, got {from} and {to}"));
        }
        if scale == Scale::Log && from <= 0.0 {
            return Err(format!(
                "it is logarithmic and begins at {from}; begin above 0, or use scale = \"linear\""
            ));
        }
        if whole && (from.fract() != 0.0 || to.fract() != 0.0 || from < 0.0) {
            return Err(format!(
                "this field takes whole numbers, got {from} and {to}; give whole ends"
            ));
        }
        Ok(())
    }

    /// Returns the number at fraction `share` of the range.
    pub(crate) fn at(&self, share: f64) -> f64 {
        match self.scale {
            Scale::Linear => self.from + (self.to - self.from) * share,
            Scale::Log => self.from * (self.to / self.from).powf(share),
        }
    }

    pub(crate) fn rounded(&self, value: f64) -> f64 {
        let value = match self.scale {
            _ if self.whole => value.round(),
            Scale::Linear => decimals(value, self.to - self.from),
            Scale::Log => calib_core::rounded(value, 3),
        };
        // Keeps the ends exactly as the study writes them.
        value.clamp(self.from, self.to)
    }

    /// Maps a uniform draw from `[0, 1)` to a value.
    pub(crate) fn draw(&self, unit: f64) -> f64 {
        match self.scale {
            // Every whole number is equally likely, including the ends.
            Scale::Linear if self.whole => {
                (self.from + (unit * (self.to - self.from + 1.0)).floor()).min(self.to)
            }
            _ => self.rounded(self.at(unit)),
        }
    }

    /// Converts a number to a value of the field.
    pub(crate) fn value(&self, value: f64) -> Value {
        if self.whole { Value::from(value.round() as u64) } else { Value::from(value) }
    }
}

/// Rounds `value` to three more decimals than the leading digit of `spacing` has.
pub(crate) fn decimals(value: f64, spacing: f64) -> f64 {
    let places = (3.0 - spacing.log10().floor()).clamp(0.0, 17.0) as usize;
    format!("{value:.places$}").parse().unwrap_or_else(|_| unreachable!("a formatted number"))
}
