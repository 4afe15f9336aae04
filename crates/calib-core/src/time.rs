use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _};

/// An instant in microseconds since 1970-01-01T00:00:00.
///
/// Logs with a time zone are converted to UTC. Logs without one keep their wall-clock reading. In JSON an instant is
/// RFC 3339 text in UTC, or a number of microseconds where RFC 3339 cannot write the year.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Timestamp(i64);

impl Timestamp {
    /// Returns the instant `micros` microseconds after the epoch.
    pub const fn from_micros(micros: i64) -> Self {
        Self(micros)
    }

    /// Returns microseconds since the epoch.
    pub const fn as_micros(self) -> i64 {
        self.0
    }

    /// Returns the span from `earlier` to `self`, in microseconds; negative if `earlier` is later.
    pub const fn micros_since(self, earlier: Self) -> i64 {
        self.0 - earlier.0
    }

    /// Returns the instant `periods` sampling intervals later.
    #[must_use]
    pub const fn plus(self, period: Period, periods: i64) -> Self {
        Self(self.0 + period.0 * periods)
    }
}

/// The years that RFC 3339 can write, from 0000-01-01T00:00:00Z to before 10000-01-01T00:00:00Z, in microseconds.
const WRITABLE: std::ops::Range<i64> = -62_167_219_200_000_000..253_402_300_800_000_000;

/// The representation in JSON.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Stored {
    Text(String),
    Micros(i64),
}

impl Serialize for Timestamp {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let writable =
            WRITABLE.contains(&self.0).then(|| jiff::Timestamp::from_microsecond(self.0));
        match writable {
            Some(Ok(instant)) => Stored::Text(instant.to_string()),
            _ => Stored::Micros(self.0),
        }
        .serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Timestamp {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match Stored::deserialize(deserializer)? {
            Stored::Text(text) => {
                let instant = text.parse::<jiff::Timestamp>().or_else(|_| {
                    // Files of earlier versions have no offset.
                    let clock = text.parse::<jiff::civil::DateTime>()?;
                    clock.to_zoned(jiff::tz::TimeZone::UTC).map(|zoned| zoned.timestamp())
                });
                Ok(Self(instant.map_err(D::Error::custom)?.as_microsecond()))
            }
            Stored::Micros(micros) => Ok(Self(micros)),
        }
    }
}

impl JsonSchema for Timestamp {
    fn schema_name() -> Cow<'static, str> {
        "Timestamp".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "description": "A time as RFC 3339 has it, in UTC; of a log without a time zone its clock's reading, as if that were UTC. \
                A number is in microseconds since 1970: outside of the years 0 to 9999.",
            "anyOf": [{ "type": "string", "format": "date-time" }, { "type": "integer" }],
        })
    }
}

/// The time from one sample to the next, in microseconds; always positive.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
#[serde(transparent)]
pub struct Period(i64);

impl Period {
    /// Returns a period of `micros` microseconds, or `None` unless it is positive.
    pub const fn from_micros(micros: i64) -> Option<Self> {
        if micros > 0 { Some(Self(micros)) } else { None }
    }

    /// Returns a period of `secs` seconds, or `None` unless it rounds to at least one microsecond.
    pub fn from_secs(secs: f64) -> Option<Self> {
        let micros = (secs * 1e6).round();
        if micros >= 1.0 && micros < i64::MAX as f64 { Some(Self(micros as i64)) } else { None }
    }

    /// Returns the length in microseconds.
    pub const fn as_micros(self) -> i64 {
        self.0
    }

    /// Returns the length in seconds.
    pub fn as_secs(self) -> f64 {
        self.0 as f64 / 1e6
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn periods_are_positive() {
        assert_eq!(Period::from_micros(0), None);
        assert_eq!(Period::from_secs(-1.0), None);
        assert_eq!(Period::from_secs(f64::NAN), None);
        assert_eq!(Period::from_secs(0.5).map(Period::as_micros), Some(500_000));
    }

    /// Returns the JSON text of a time.
    fn json(micros: i64) -> String {
        serde_json::to_string(&Timestamp(micros)).expect("JSON")
    }

    #[test]
    fn times_survive_a_file() {
        assert_eq!(json(1_500_000), "\"1970-01-01T00:00:01.5Z\"");
        assert_eq!(json(WRITABLE.start), "\"0000-01-01T00:00:00Z\"");
        assert_eq!(json(WRITABLE.end), WRITABLE.end.to_string());
        for micros in [i64::MIN, WRITABLE.start, -1, 0, 1_667_282_400_000_001, WRITABLE.end - 1] {
            let read: Timestamp = serde_json::from_str(&json(micros)).expect("a time");
            assert_eq!(read.0, micros);
        }
        let earlier: Timestamp = serde_json::from_str("\"1970-01-01 00:00:01\"").expect("a time");
        assert_eq!(earlier.0, 1_000_000);
    }

    #[test]
    fn steps_of_a_period_add_up() {
        let start = Timestamp::from_micros(10);
        let later = start.plus(Period::from_secs(1.0).expect("positive"), 3);
        assert_eq!(later.micros_since(start), 3_000_000);
    }
}
