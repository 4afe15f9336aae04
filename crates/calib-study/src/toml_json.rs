//! Conversion of values between TOML and JSON.

use serde_json::Value as Json;
use toml::Value;

use crate::error::Problem;

/// Converts to JSON. Dates and times become text, and numbers that are not finite become null.
pub(crate) fn to_json(value: &Value) -> Json {
    match value {
        Value::String(text) => Json::from(text.as_str()),
        Value::Integer(number) => Json::from(*number),
        Value::Float(number) => Json::from(*number),
        Value::Boolean(truth) => Json::from(*truth),
        Value::Datetime(time) => Json::from(time.to_string()),
        Value::Array(values) => values.iter().map(to_json).collect(),
        Value::Table(table) => {
            Json::Object(table.iter().map(|(key, value)| (key.clone(), to_json(value))).collect())
        }
    }
}

/// Converts to TOML, which has no null.
pub(crate) fn to_toml(value: &Json) -> Result<Value, Problem> {
    Value::try_from(value).map_err(|error| {
        Problem::from(error).after(&format!("{value} cannot be written to a study"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_come_back() {
        let text = "a = 1\nb = [0.5, \"x\", true]\n[c]\nd = -3\n";
        let table: toml::Table = toml::from_str(text).expect("TOML");
        let value = Value::Table(table);
        assert_eq!(to_toml(&to_json(&value)).expect("no nothing in it"), value);
        let date: toml::Table = toml::from_str("start = 2022-11-01\n").expect("TOML");
        assert_eq!(to_json(&date["start"]), Json::from("2022-11-01"));
        assert!(to_toml(&Json::Null).is_err());
    }
}
