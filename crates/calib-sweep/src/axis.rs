use calib_agent::AgentConfig;
use serde::{Deserialize, Deserializer, Serialize, de::Error as _};
use serde_json::Value;

use crate::{
    SweepError,
    range::{Range, Span},
};

/// What one field of the agent is swept over: a list of values, or a range.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Axis {
    /// These values.
    List(Vec<Value>),
    /// A range of numbers.
    Range(Range),
}

impl<'de> Deserialize<'de> for Axis {
    /// By hand, because serde's untagged enums do not say what is wrong.
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

/// The values of an axis, ready to be enumerated or drawn from.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Points {
    /// Each of these.
    Discrete(Vec<Value>),
    /// Anything in between.
    Continuous(Span),
}

impl Axis {
    /// Its values as those of the agent's field `field`.
    pub(crate) fn points(&self, field: &str, agent: &AgentConfig) -> Result<Points, SweepError> {
        let fields = fields(agent);
        let Some(own) = fields.get(field) else {
            let known = fields.keys().cloned().collect::<Vec<_>>().join(", ");
            return Err(SweepError::UnknownField { field: field.to_owned(), known });
        };
        let points = match self {
            Self::List(values) => Points::Discrete(values.clone()),
            Self::Range(range) if own.is_number() => range
                .points(own.is_u64())
                .map_err(|reason| SweepError::Range { field: field.to_owned(), reason })?,
            Self::Range(_) => {
                let reason = "its values are no numbers; give a list".to_owned();
                return Err(SweepError::Range { field: field.to_owned(), reason });
            }
        };
        if let Points::Discrete(values) = &points {
            check_values(field, values)?;
        }
        Ok(points)
    }
}

/// Every field of an agent, as in a study.
pub(crate) fn fields(agent: &AgentConfig) -> serde_json::Map<String, Value> {
    match serde_json::to_value(agent) {
        Ok(Value::Object(fields)) => fields,
        _ => unreachable!("an agent's configuration is a table"),
    }
}

fn check_values(field: &str, values: &[Value]) -> Result<(), SweepError> {
    if values.is_empty() {
        return Err(SweepError::EmptyField { field: field.to_owned() });
    }
    // 1 and 1.0 are one value.
    let same = |a: &Value, b: &Value| match (a.as_f64(), b.as_f64()) {
        (Some(a), Some(b)) => a == b,
        _ => a == b,
    };
    for (position, value) in values.iter().enumerate() {
        if values[..position].iter().any(|earlier| same(earlier, value)) {
            let value = crate::written(value);
            return Err(SweepError::RepeatedValue { field: field.to_owned(), value });
        }
    }
    Ok(())
}
