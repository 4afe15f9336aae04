//! Parts of a study that replace others: `[models.NAME]`, `[profiles.NAME]`.

use anyhow::bail;
use toml::{Table, Value};

/// Every key of `own` replaces that of `table`; sections are laid over each other.
pub(super) fn lay_over(table: &mut Table, own: Table) {
    for (key, value) in own {
        match (table.get_mut(&key), value) {
            (Some(Value::Table(below)), Value::Table(above)) => lay_over(below, above),
            (_, value) => {
                table.insert(key, value);
            }
        }
    }
}

/// Names in the section `key`, in alphabetical order.
pub(super) fn names(table: &Table, key: &str) -> Vec<String> {
    let section = table.get(key).and_then(Value::as_table);
    let mut names: Vec<String> = section.map_or_else(Vec::new, |of| of.keys().cloned().collect());
    names.sort();
    names
}

/// Take what the section `key` says of `name`, which was chosen by `option`; the section is removed.
pub(super) fn take(
    table: &mut Table,
    key: &str,
    option: &str,
    name: &str,
) -> anyhow::Result<Table> {
    let names = names(table, key);
    match table.remove(key) {
        Some(Value::Table(mut section)) if section.contains_key(name) => {
            match section.remove(name) {
                Some(Value::Table(own)) => Ok(own),
                _ => bail!("[{key}] {name} is a value, not a section"),
            }
        }
        _ if names.is_empty() => {
            bail!("{option} {name}: the study has no [{key}.{name}], nor any other [{key}] section")
        }
        _ => bail!("{option} {name}: the study's {key} are {}", names.join(", ")),
    }
}

/// Whether every name in the section `key` can be that of a directory.
pub(super) fn check_names<'a>(
    key: &str,
    names: impl IntoIterator<Item = &'a String>,
) -> anyhow::Result<()> {
    let fine = |name: &&String| {
        !name.is_empty()
            && name.chars().all(|of| of.is_ascii_alphanumeric() || of == '-' || of == '_')
    };
    match names.into_iter().find(|name| !fine(name)) {
        Some(name) => bail!("[{key}.\"{name}\"]: names have ASCII letters, digits, - and _ only"),
        None => Ok(()),
    }
}
