//! The study that plants are drawn from.

use std::{
    collections::BTreeMap,
    path::{Component, Path, PathBuf},
};

use calib_core::Seed;
use calib_sweep::Axis;
use toml::{Table, Value};

use super::plants::Plants;
use crate::{
    error::{Problem, require},
    overlay::lay_over,
    overrides,
    toml_json::to_toml,
    written,
};

/// Exclusive upper limit of drawn seeds, which keeps them short enough to type.
const SEEDS: usize = 1_000_000_000;

/// The study that plants are drawn from.
pub(super) struct Template {
    /// Name of its file without `.toml`.
    pub(super) name: String,
    /// Path as the protocol writes it.
    pub(super) file: PathBuf,
    table: Table,
}

impl Template {
    /// Reads the study of `plants`, and rewrites its paths relative to `folder`.
    pub(super) fn read(protocol: &Path, plants: &Plants, folder: &Path) -> Result<Self, Problem> {
        let beside = protocol.parent().unwrap_or(Path::new(""));
        let path = beside.join(&plants.study);
        let mut table = written::table_of(&path)?;
        let name = path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
        let name = name.ok_or_else(|| Problem::new(format!("{} has no name", path.display())))?;
        require!(
            plants.repeat.is_none() || table.contains_key("simulate"),
            "repeat requires a study with [simulate]: without it {} would be the same plant again",
            path.display()
        );
        // Results go beside the drawn study. Input files stay where they are.
        table.remove("output");
        move_paths(&mut table, path.parent().unwrap_or(Path::new("")), folder)?;
        Ok(Self { name, file: plants.study.clone(), table })
    }

    /// Draws a value for each of `axes`, and seeds for the study and its plant.
    /// `section` names the section that asks for a key.
    pub(super) fn values(
        &self,
        axes: &BTreeMap<String, Axis>,
        seed: Seed,
        defaults: &serde_json::Value,
        section: impl Fn(&str) -> String,
    ) -> Result<BTreeMap<String, Value>, Problem> {
        let mut values = axes
            .iter()
            .map(|(key, axis)| {
                let like = defaults.pointer(&format!("/{}", key.replace('.', "/")));
                let drawn = axis.draw(like, seed.child(key).rng().unit());
                let told = format!("{}: {key} cannot be drawn", section(key));
                let drawn = drawn.map_err(|error| Problem::from(error).after(&told))?;
                Ok((key.clone(), to_toml(&drawn).map_err(|problem| problem.after(key))?))
            })
            .collect::<Result<BTreeMap<_, _>, Problem>>()?;
        let simulated = self.table.contains_key("simulate").then_some("simulate.seed");
        for key in ["seed"].into_iter().chain(simulated) {
            let own = seed.child(key).rng().below(SEEDS) as i64;
            values.entry(key.to_owned()).or_insert(Value::Integer(own));
        }
        Ok(values)
    }

    /// Returns the study with `values` and then `overrides` applied. Values come in key order, so a section precedes its keys.
    pub(super) fn with(
        &self,
        plant: &str,
        values: &BTreeMap<String, Value>,
        overrides: &[String],
    ) -> Result<Table, Problem> {
        let mut table = self.table.clone();
        for (key, value) in values {
            let (sections, last) = key.rsplit_once('.').unwrap_or(("", key));
            let mut own = Table::from_iter([(last.to_owned(), value.clone())]);
            for section in sections.rsplit('.').filter(|section| !section.is_empty()) {
                own = Table::from_iter([(section.to_owned(), Value::Table(own))]);
            }
            lay_over(&mut table, own);
        }
        if table.contains_key("simulate") {
            let path = Value::String(format!("data/{plant}"));
            let data = Table::from_iter([("path".to_owned(), path)]);
            lay_over(&mut table, Table::from_iter([("data".to_owned(), Value::Table(data))]));
        }
        overrides.iter().try_for_each(|text| overrides::apply(&mut table, text))?;
        Ok(table)
    }
}

/// Keys that name files or folders, relative to the folder of the study.
const PATHS: [(&str, &str); 2] = [("data", "path"), ("pretrain", "checkpoint")];

/// Rewrites the relative paths of a study in `from` so that they mean the same in a study in `to`.
fn move_paths(table: &mut Table, from: &Path, to: &Path) -> Result<(), Problem> {
    for (section, key) in PATHS {
        let Some(value) = table.get_mut(section).and_then(|section| section.get_mut(key)) else {
            continue;
        };
        let texts = match value {
            Value::Array(all) => all.iter_mut().collect(),
            one => vec![one],
        };
        for text in texts {
            let moved = text.as_str().map(|path| moved(path, from, to)).transpose()?;
            if let Some(moved) = moved.flatten() {
                *text = Value::String(moved);
            }
        }
    }
    Ok(())
}

/// Rewrites a path in `from` as a path in `to`; `None` if it means the same in both.
fn moved(path: &str, from: &Path, to: &Path) -> Result<Option<String>, Problem> {
    if path.is_empty() || path.starts_with("${") || Path::new(path).is_absolute() {
        return Ok(None);
    }
    Ok(Some(relative(&from.join(path), to)?.display().to_string()))
}

/// Returns `path` relative to `folder`.
fn relative(path: &Path, folder: &Path) -> Result<PathBuf, Problem> {
    let path = without_parents(path)?;
    let folder = without_parents(folder)?;
    let common = path.components().zip(folder.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(common).map(|_| "..");
    let down = path.components().skip(common).map(Component::as_os_str);
    Ok(up.map(AsRef::as_ref).chain(down).collect())
}

/// Returns the absolute path without `..`.
fn without_parents(path: &Path) -> Result<PathBuf, Problem> {
    let mut plain = PathBuf::new();
    for part in std::path::absolute(path)?.components() {
        match part {
            Component::ParentDir => {
                plain.pop();
            }
            part => plain.push(part),
        }
    }
    Ok(plain)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rebased(path: &str, folder: &str) -> String {
        relative(Path::new(path), Path::new(folder)).expect("paths").display().to_string()
    }

    #[test]
    fn paths_are_written_from_another_folder() {
        assert_eq!(rebased("a/logs", "a/results/studies"), "../../logs");
        assert_eq!(rebased("a/../logs/x", "b/../c"), "../logs/x");
        assert_eq!(rebased("a/b", "a"), "b");
    }
}
