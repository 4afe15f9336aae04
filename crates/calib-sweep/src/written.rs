use itertools::Itertools as _;
use serde_json::Value;

/// Formats a swept value as in a study: `1e-4`, `0.05`, `1000`, `adam`. Numbers below 0.01 have an exponent, as in
/// reports.
pub fn written(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Number(number) => match number.as_f64() {
            Some(float) if float != 0.0 && !(1e-2..1e6).contains(&float.abs()) => {
                format!("{float:e}")
            }
            Some(float) if float.fract() == 0.0 => format!("{float:.0}"),
            _ => number.to_string(),
        },
        Value::Array(values) => format!("[{}]", values.iter().map(written).join(", ")),
        other => other.to_string(),
    }
}
