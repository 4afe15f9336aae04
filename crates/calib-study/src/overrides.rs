//! Overrides of single keys of a study: `--set section.key=value`.

use std::path::Path;

use toml::{Table, Value};

use crate::{
    Study, StudyError,
    error::{Problem, refuse, require},
    typed::typed,
    without_model,
};

/// Returns a study of the log at `path`. All other keys have their
/// defaults or the values in `overrides`.
///
/// # Errors
/// If a key does not exist, or a value is not valid.
pub fn of_data(path: &Path, overrides: &[String]) -> Result<Study, StudyError> {
    let mut table = Table::new();
    overrides.iter().try_for_each(|text| apply(&mut table, text))?;
    without_model::check(&table, std::slice::from_ref(&table))?;
    let mut study = typed(table).map_err(|problem| {
        let given: Vec<String> = overrides.iter().map(|text| format!("--set {text}")).collect();
        problem.after(&given.join(" "))
    })?;
    study.data.path = path.to_owned().into();
    study.check()?;
    Ok(study)
}

/// Returns the key of `section.key=value`.
pub(crate) fn key(text: &str) -> &str {
    text.split('=').next().unwrap_or_default().trim()
}

/// Whether `key` is `parent`, or a key in that section.
pub(crate) fn is_inside(key: &str, parent: &str) -> bool {
    key.strip_prefix(parent).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
}

/// Applies one `section.key=value`. The value is TOML, or plain text if it is not valid TOML.
pub(crate) fn apply(table: &mut Table, text: &str) -> Result<(), Problem> {
    let expected = "expected section.key=value, such as agent.gamma=0.9";
    let (keys, value) =
        text.split_once('=').ok_or_else(|| Problem::new(format!("--set {text}: {expected}")))?;
    let value = value.trim();
    let parsed = toml::from_str::<Table>(&format!("value = {value}"))
        .ok()
        .and_then(|mut parsed| parsed.remove("value"))
        .map_or_else(|| plain_text(text, value), Ok)?;
    let keys: Vec<&str> = keys.trim().split('.').map(str::trim).collect();
    let (last, sections) =
        keys.split_last().ok_or_else(|| Problem::new(format!("--set {text}: {expected}")))?;
    if keys.iter().any(|key| key.is_empty()) {
        refuse!("--set {text}: {expected}");
    }
    let mut place = table;
    for section in sections {
        let entry = place.entry(*section).or_insert_with(|| Value::Table(Table::new()));
        let Value::Table(inner) = entry else {
            refuse!("--set {text}: `{section}` is a value, not a section");
        };
        place = inner;
    }
    place.insert((*last).to_owned(), parsed);
    Ok(())
}

/// Accepts a value that is not TOML as plain text, unless it was clearly meant to be TOML.
fn plain_text(text: &str, value: &str) -> Result<Value, Problem> {
    require!(
        !value.starts_with(['[', '{', '"', '\''])
            && !value.starts_with(|first: char| first.is_ascii_digit()),
        "--set {text}: `{value}` is not a TOML value: a number, \"text\", [list], {{ table }} or date"
    );
    Ok(Value::String(value.to_owned()))
}
