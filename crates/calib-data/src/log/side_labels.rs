//! Labels in columns beside the samples of a long table, such as the name of the device: samples of one tag may come
//! from several devices.

use std::collections::BTreeMap;

use calib_core::abridged_list;

use super::{
    column_aliases::{REMARKS, names_plants, plain},
    file::FieldKind,
    head::{Head, HeadColumn},
};
use crate::{DataConfig, DataError};

/// Columns that differ between samples of one device, in addition to [`REMARKS`].
const STATES: [&str; 3] = ["status", "quality", "state"];
/// A column with more distinct words in its first rows does not name devices.
const DEVICES: usize = 20;
/// Maximum number of tags in a warning.
const NAMED: usize = 3;

/// A column beside the samples that may name devices.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SideColumn {
    pub(crate) position: usize,
    pub(crate) name: String,
}

/// Returns the columns of a long table that may name devices: columns of few distinct words that have no role. `roles`
/// are the positions with a role.
pub(crate) fn side_columns(
    head: &Head,
    columns: &[HeadColumn],
    roles: &[usize],
    data: &DataConfig,
) -> Result<Vec<SideColumn>, DataError> {
    let mut sides = Vec::new();
    for (position, HeadColumn { name, kind }) in columns.iter().enumerate() {
        let called = plain(name);
        let is_known = roles.contains(&position)
            || data.only.contains_key(name)
            || REMARKS.contains(&called.as_str())
            || STATES.contains(&called.as_str());
        if is_known || !(*kind == FieldKind::Text || names_plants(name)) {
            continue;
        }
        let mut words = head.sample(position)?;
        words.sort_unstable();
        words.dedup();
        if words.len() <= DEVICES {
            sides.push(SideColumn { position, name: name.clone() });
        }
    }
    Ok(sides)
}

/// The labels of a column beside the samples of one tag: the first word, and a different one if there is one.
#[derive(Clone, Debug, Default)]
pub(crate) struct SideLabels {
    first: Option<String>,
    other: Option<String>,
}

impl SideLabels {
    /// Whether `bytes` cannot add anything. Most of the time they repeat the row before.
    pub(crate) fn knows(&self, bytes: &[u8]) -> bool {
        self.other.is_some() || self.first.as_ref().is_some_and(|first| first.as_bytes() == bytes)
    }

    pub(crate) fn add(&mut self, word: &str) {
        let word = word.trim();
        if word.is_empty() {
            return;
        }
        match &self.first {
            None => self.first = Some(word.to_owned()),
            Some(first) if first != word && self.other.is_none() => {
                self.other = Some(word.to_owned());
            }
            Some(_) => {}
        }
    }

    /// Adds the labels that another thread or another file has found.
    pub(crate) fn merge(&mut self, other: &Self) {
        for word in other.first.iter().chain(&other.other) {
            self.add(word);
        }
    }
}

/// Returns warnings about tags whose samples have several words in a column. `tags` are names of tags, with the labels
/// of each column beside them.
pub(crate) fn mixed<'a>(
    tags: impl Iterator<Item = (&'a str, &'a BTreeMap<String, SideLabels>)>,
) -> Vec<String> {
    let mut by_column: BTreeMap<&str, Vec<(&str, &SideLabels)>> = BTreeMap::new();
    for (tag, sides) in tags {
        for (column, labels) in sides.iter().filter(|(_, labels)| labels.other.is_some()) {
            by_column.entry(column).or_default().push((tag, labels));
        }
    }
    by_column
        .into_iter()
        .map(|(column, tags)| {
            let labels = tags[0].1;
            let words = labels.first.iter().chain(&labels.other);
            let words: Vec<&str> = words.map(String::as_str).collect();
            format!(
                "{} {} samples of several {column:?}, such as {}: if these are different devices, choose one with data.where = {{ {column:?} = {:?} }}",
                abridged_list(tags.iter().map(|tag| tag.0), NAMED),
                if tags.len() == 1 { "has" } else { "have" },
                words.join(" and "),
                words[0]
            )
        })
        .collect()
}
