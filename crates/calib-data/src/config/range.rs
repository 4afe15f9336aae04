use std::{borrow::Cow, fmt};

use calib_core::Timestamp;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{
    Deserialize, Deserializer, Serialize,
    de::{self, MapAccess, Visitor},
};

use calib_text::parse_time;

/// A date, or a date and time, as it stands in the study: text, or a TOML date.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct Moment {
    text: String,
    #[serde(skip)]
    instant: Timestamp,
}

impl Moment {
    /// Reads the moment in `text`: `2022-11-01`, `2022-11-01T06:00:00`, or with an offset. Without an offset
    /// it is read like the log: on the clock of `data.time_zone`, or else unchanged, which is UTC if the log
    /// has a time zone.
    ///
    /// # Errors
    /// If `text` is neither a date nor a date and time.
    pub fn new(text: &str) -> Result<Self, String> {
        parse_time(text)
            .map(|instant| Self {
                text: text.to_owned(),
                instant,
            })
            .ok_or_else(|| {
                format!(
                    "{text:?} is not a time; expected a date such as 2022-11-01 or a date and time such as 2022-11-01T06:00:00"
                )
            })
    }

    /// Returns a moment with the same text at another instant.
    pub(crate) fn moved_to(&self, instant: Timestamp) -> Self {
        Self { text: self.text.clone(), instant }
    }

    /// Returns the instant.
    pub fn instant(&self) -> Timestamp {
        self.instant
    }
}

impl fmt::Display for Moment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl JsonSchema for Moment {
    fn schema_name() -> Cow<'static, str> {
        "Moment".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "description": "A date, or a date and time, as text or as TOML has them",
            "type": "string",
            "examples": ["2022-11-01", "2022-11-01T06:00:00", "2022-11-01T06:00:00+01:00"],
        })
    }
}

impl<'de> Deserialize<'de> for Moment {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct MomentVisitor;

        impl<'de> Visitor<'de> for MomentVisitor {
            type Value = Moment;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a date or a date and time")
            }

            fn visit_str<E: de::Error>(self, text: &str) -> Result<Moment, E> {
                Moment::new(text).map_err(E::custom)
            }

            // TOML's own dates arrive as a map with one private key.
            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Moment, A::Error> {
                match map.next_entry::<String, String>()? {
                    Some((_, text)) => self.visit_str(&text),
                    None => Err(de::Error::invalid_length(0, &self)),
                }
            }
        }

        deserializer.deserialize_any(MomentVisitor)
    }
}

/// A range of time, from `start` up to but not including `end`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TimeRange {
    /// Start of the range, included. Default: the beginning of the log.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start: Option<Moment>,
    /// End of the range, not included. Default: the end of the log.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub end: Option<Moment>,
}

impl fmt::Display for TimeRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.start, &self.end) {
            (Some(start), Some(end)) => write!(f, "{start} .. {end}"),
            (Some(start), None) => write!(f, "{start} .. end of the log"),
            (None, Some(end)) => write!(f, "beginning of the log .. {end}"),
            (None, None) => f.write_str("the whole log"),
        }
    }
}
