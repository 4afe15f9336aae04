//! A table of TOML as a study.

use serde::Deserialize as _;
use toml::{Table, Value};

use crate::{Study, error::Problem, message::friendly, without_model};

/// Converts a table to a study.
pub(crate) fn typed(mut table: Table) -> Result<Study, Problem> {
    without_model::set_rule(&mut table);
    Study::deserialize(Value::Table(table)).map_err(|error| located(&error))
}

/// Converts a TOML error to a problem that names the key at fault.
fn located(error: &toml::de::Error) -> Problem {
    let text = error.to_string();
    let key = text.lines().find_map(|line| line.trim().strip_prefix("in `"));
    let message = friendly(error.message());
    let Some(section) = key.map(|key| key.trim_end_matches('`')) else {
        return Problem::new(message);
    };
    let unknown = message.strip_prefix("unknown key `").and_then(|rest| rest.split('`').next());
    let key = unknown.map_or_else(|| section.to_owned(), |key| format!("{section}.{key}"));
    Problem::of_key(key, format!("{section}: {message}"))
}
