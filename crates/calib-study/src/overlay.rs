//! Parts of a study that replace other parts: `[models.NAME]`, `[profiles.NAME]`.

use toml::{Table, Value};

use crate::error::{Problem, refuse};

/// Replaces every key of `table` that `own` has. Sections are merged key by key.
pub(crate) fn lay_over(table: &mut Table, own: Table) {
    for (key, value) in own {
        match (table.get_mut(&key), value) {
            (Some(Value::Table(below)), Value::Table(above)) => lay_over(below, above),
            (_, value) => {
                table.insert(key, value);
            }
        }
    }
}

/// Returns the names in the section `key` in alphabetical order.
pub(crate) fn names(table: &Table, key: &str) -> Vec<String> {
    let section = table.get(key).and_then(Value::as_table);
    let mut names: Vec<String> =
        section.map_or_else(Vec::new, |table| table.keys().cloned().collect());
    names.sort();
    names
}

/// Removes the section `key` and returns its entry `name`. `option` is
/// the command-line option that chose it.
pub(crate) fn take(
    table: &mut Table,
    key: &str,
    option: &str,
    name: &str,
) -> Result<Table, Problem> {
    let names = names(table, key);
    match table.remove(key) {
        Some(Value::Table(mut section)) if section.contains_key(name) => {
            match section.remove(name) {
                Some(Value::Table(own)) => Ok(own),
                _ => refuse!("[{key}] {name} is a value, not a section"),
            }
        }
        _ if names.is_empty() => {
            refuse!(
                "{option} {name}: the study has no [{key}.{name}], nor any other [{key}] section; add it, or leave {option} out"
            )
        }
        _ => refuse!("{option} {name}: the study's {key} are {}", names.join(", ")),
    }
}

/// Checks that each name in the section `key` can be the name of a directory.
pub(crate) fn check_names<'a>(
    key: &str,
    names: impl IntoIterator<Item = &'a String>,
) -> Result<(), Problem> {
    match names.into_iter().find(|name| !is_directory_name(name)) {
        Some(name) => refuse!("[{key}.\"{name}\"]: names have ASCII letters, digits, - and _ only"),
        None => Ok(()),
    }
}

/// Whether the name is a valid directory name on every operating system.
fn is_directory_name(name: &str) -> bool {
    !name.is_empty()
        && name
            .chars()
            .all(|letter| letter.is_ascii_alphanumeric() || letter == '-' || letter == '_')
}
