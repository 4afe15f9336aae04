use std::borrow::Cow;

use calib_agent::AgentConfig;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Deserializer, Serialize, de::Error as _};
use serde_json::Value;

use crate::{SweepError, points::Points, range::Range};

/// The values that one swept field takes: a list or a range.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Axis {
    /// A list of values.
    List(Vec<Value>),
    /// A range of numbers.
    Range(Range),
}

impl JsonSchema for Axis {
    fn schema_name() -> Cow<'static, str> {
        "Axis".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let range = generator.subschema_for::<Range>();
        json_schema!({
            "description": "A list of values, or a range of numbers",
            "anyOf": [{ "type": "array", "minItems": 1 }, range],
        })
    }
}

impl<'de> Deserialize<'de> for Axis {
    /// Written by hand: errors of serde's untagged enums do not say what is wrong.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match Value::deserialize(deserializer)? {
            Value::Array(values) => Ok(Self::List(values)),
            table @ Value::Object(_) => {
                serde_json::from_value(table).map(Self::Range).map_err(D::Error::custom)
            }
            other => Err(D::Error::custom(format!(
                "expected a list of values or a range such as {{ from = 1e-6, to = 1e-1, per_decade = 2 }}, got {other}"
            ))),
        }
    }
}

impl From<Vec<Value>> for Axis {
    fn from(values: Vec<Value>) -> Self {
        Self::List(values)
    }
}

/// An error in the values of an axis.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AxisError {
    /// An empty list.
    #[error("it has no values; give a list such as [0.8, 0.9], or a range")]
    Empty,
    /// A list with a repeated value.
    #[error("it has the value {value} twice; remove one")]
    Repeated {
        /// The repeated value.
        value: String,
    },
    /// A range that holds no values.
    #[error("{reason}")]
    Range {
        /// The reason.
        reason: String,
    },
}

impl Axis {
    /// Maps a uniform draw `unit` from `[0, 1)` to a value. Each value of a list, or of a range that stands for a list,
    /// is equally likely. An open range is sampled uniformly, on a linear or a logarithmic scale.
    ///
    /// `like` is a value of the field, such as its default. If it is a whole number, the drawn values are whole numbers
    /// too.
    ///
    /// # Errors
    /// Returns an error for an empty list, a repeated value, a range without numbers, or a range for a field that is no
    /// number.
    pub fn draw(&self, like: Option<&Value>, unit: f64) -> Result<Value, AxisError> {
        Ok(self.points_like(like)?.draw(unit).1)
    }

    /// Returns the values of the axis for a field whose values look like `like`.
    fn points_like(&self, like: Option<&Value>) -> Result<Points, AxisError> {
        let points = match self {
            Self::List(values) => Points::Discrete(values.clone()),
            Self::Range(range) if like.is_none_or(Value::is_number) => range
                .points(like.is_some_and(Value::is_u64))
                .map_err(|reason| AxisError::Range { reason })?,
            Self::Range(_) => {
                let reason = "its values are no numbers; give a list".to_owned();
                return Err(AxisError::Range { reason });
            }
        };
        if let Points::Discrete(values) = &points {
            check_values(values)?;
        }
        Ok(points)
    }

    /// Returns the values of the axis for the agent field `field`.
    pub(crate) fn points(&self, field: &str, agent: &AgentConfig) -> Result<Points, SweepError> {
        let fields = agent.fields();
        let Some(own) = fields.get(field) else {
            let can_be_swept = fields.keys().filter(|key| *key != "gamma");
            let known = can_be_swept.cloned().collect::<Vec<_>>().join(", ");
            let section = if agent.is_external() { "[agent.parameters]" } else { "[agent]" };
            if fields.len() < 2 && agent.is_external() {
                return Err(SweepError::NoParameters { field: field.to_owned() });
            }
            return Err(SweepError::UnknownField { field: field.to_owned(), section, known });
        };
        self.points_like(Some(own)).map_err(|error| {
            let field = field.to_owned();
            match error {
                AxisError::Empty => SweepError::EmptyField { field },
                AxisError::Repeated { value } => SweepError::RepeatedValue { field, value },
                AxisError::Range { reason } => SweepError::Range { field, reason },
            }
        })
    }
}

fn check_values(values: &[Value]) -> Result<(), AxisError> {
    if values.is_empty() {
        return Err(AxisError::Empty);
    }
    for (position, value) in values.iter().enumerate() {
        if values[..position].iter().any(|earlier| are_same(earlier, value)) {
            return Err(AxisError::Repeated { value: crate::written(value) });
        }
    }
    Ok(())
}

/// Whether two values are equal. The numbers 1 and 1.0 are.
fn are_same(a: &Value, b: &Value) -> bool {
    match (a.as_f64(), b.as_f64()) {
        (Some(a), Some(b)) => a == b,
        _ => a == b,
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn axis(text: &str) -> Axis {
        serde_json::from_str(text).expect("an axis")
    }

    #[test]
    fn draws_are_values_of_the_field() {
        let gammas = axis("[0.8, 0.9, 0.95]");
        let drawn = [0.0, 0.34, 0.999].map(|unit| gammas.draw(None, unit).expect("valid"));
        assert_eq!(drawn, [json!(0.8), json!(0.9), json!(0.95)]);
        let batches = axis(r#"{"from": 4, "to": 64, "scale": "log"}"#);
        assert_eq!(batches.draw(Some(&json!(256)), 0.5), Ok(json!(16)), "the field is whole");
        assert_eq!(batches.draw(Some(&json!(2.5)), 0.5), Ok(json!(16.0)));
        let days = axis(r#"{"from": 3, "to": 4, "whole": true}"#);
        assert_eq!([0.1, 0.9].map(|unit| days.draw(None, unit)), [Ok(json!(3)), Ok(json!(4))]);
        let tables = axis(r#"[{"hidden_units": 16}, {"value_function": "linear"}]"#);
        assert_eq!(tables.draw(Some(&json!({})), 0.0), Ok(json!({"hidden_units": 16})));
    }

    fn error(text: &str, like: &Value) -> AxisError {
        axis(text).draw(Some(like), 0.0).expect_err(text)
    }

    #[test]
    fn what_cannot_be_drawn_from_is_refused() {
        assert_eq!(error("[]", &json!(1)), AxisError::Empty);
        assert_eq!(error("[1, 1.0]", &json!(1)), AxisError::Repeated { value: "1".to_owned() });
        let words = error(r#"{"from": 1, "to": 2}"#, &json!("adam")).to_string();
        assert!(words.contains("no numbers; give a list"), "{words}");
        assert!(matches!(error(r#"{"from": 2, "to": 1}"#, &json!(1)), AxisError::Range { .. }));
    }
}
