use std::{borrow::Cow, collections::BTreeMap, fmt};

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{
    Deserialize, Deserializer, Serialize,
    de::{Error, MapAccess, Visitor, value::MapAccessDeserializer},
};

/// Key of the entry for all channels without an entry of their own.
const DEFAULT: &str = "default";

/// How long a recorded value stands for what follows it, in seconds; a number or a table in the study.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum MaxAge {
    /// In all channels.
    All(f64),
    /// By names or glob patterns of channels. `default` is for the others.
    Channels(BTreeMap<String, f64>),
}

impl MaxAge {
    /// Returns the age for channels without an entry of their own, if the study sets it.
    pub(crate) fn default_secs(&self) -> Option<f64> {
        match self {
            Self::All(secs) => Some(*secs),
            Self::Channels(entries) => entries.get(DEFAULT).copied(),
        }
    }

    /// Returns the entries that name channels, with their seconds.
    pub(crate) fn entries(&self) -> Vec<(&String, f64)> {
        match self {
            Self::All(_) => Vec::new(),
            Self::Channels(entries) => entries
                .iter()
                .filter(|(entry, _)| *entry != DEFAULT)
                .map(|(entry, secs)| (entry, *secs))
                .collect(),
        }
    }

    /// Returns every number, with its key below `[data]`.
    pub(crate) fn keys(&self) -> Vec<(String, f64)> {
        match self {
            Self::All(secs) => vec![("max_age_secs".to_owned(), *secs)],
            Self::Channels(entries) => entries
                .iter()
                .map(|(entry, secs)| (format!("max_age_secs.{entry}"), *secs))
                .collect(),
        }
    }
}

impl JsonSchema for MaxAge {
    fn schema_name() -> Cow<'static, str> {
        "MaxAge".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "description": "Seconds, or a table of them by names or glob patterns of channels, in which `default` is for the others",
            "anyOf": [
                { "type": "number" },
                { "type": "object", "additionalProperties": { "type": "number" } },
            ],
        })
    }
}

/// Written by hand because serde's untagged enumerations do not report what is wrong with a value.
impl<'de> Deserialize<'de> for MaxAge {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct NumberOrTable;
        impl<'de> Visitor<'de> for NumberOrTable {
            type Value = MaxAge;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(
                    "a number of seconds or a table such as { default = 60, LAB01 = 86400 }",
                )
            }

            fn visit_f64<E: Error>(self, secs: f64) -> Result<MaxAge, E> {
                Ok(MaxAge::All(secs))
            }

            fn visit_i64<E: Error>(self, secs: i64) -> Result<MaxAge, E> {
                Ok(MaxAge::All(secs as f64))
            }

            fn visit_u64<E: Error>(self, secs: u64) -> Result<MaxAge, E> {
                Ok(MaxAge::All(secs as f64))
            }

            fn visit_map<A: MapAccess<'de>>(self, entries: A) -> Result<MaxAge, A::Error> {
                BTreeMap::deserialize(MapAccessDeserializer::new(entries)).map(MaxAge::Channels)
            }
        }
        deserializer.deserialize_any(NumberOrTable)
    }
}

#[cfg(test)]
mod tests {
    use crate::DataConfig;

    fn read(value: &str) -> Result<DataConfig, toml::de::Error> {
        toml::from_str(&format!("resample = 'last'\nperiod_secs = 10\nmax_age_secs = {value}\n"))
    }

    #[test]
    fn a_number_is_of_all_channels_and_a_table_names_some() {
        let all = read("60").expect("a number").max_age_secs.expect("given");
        assert_eq!((all.default_secs(), all.entries()), (Some(60.0), Vec::new()));
        let some = read("{ default = 60, \"LAB*\" = 86400 }").expect("a table");
        some.check().expect("valid");
        let some = some.max_age_secs.expect("given");
        assert_eq!(some.default_secs(), Some(60.0));
        assert_eq!(some.entries(), [(&"LAB*".to_owned(), 86_400.0)]);
        let written = toml::Value::try_from(&some).expect("a table");
        assert_eq!(written["LAB*"].as_float(), Some(86_400.0));
        let lab = read("{ LAB01 = 5 }").expect("a table").max_age_secs.expect("given");
        assert_eq!(lab.default_secs(), None, "ten periods");
    }

    #[test]
    fn what_is_no_age_is_refused_with_its_key() {
        let told = read("true").expect_err("no age").to_string();
        assert!(told.contains("a number of seconds or a table"), "{told}");
        let told = read("{ default = 60, LAB01 = 0 }").expect("read").check().expect_err("nought");
        let told = told.to_string();
        assert!(told.contains("data.max_age_secs.LAB01 = 0: "), "{told}");
        assert!(
            told.contains("a number of seconds above 0") && !told.contains("resample"),
            "{told}"
        );
        let alone = DataConfig { resample: None, ..read("60").expect("read") };
        let told = alone.check().expect_err("no clock").to_string();
        assert!(told.contains("data.max_age_secs") && told.contains("data.resample"), "{told}");
    }
}
