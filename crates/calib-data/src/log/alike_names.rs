//! Finds channels of several files whose names differ only in capital letters.

use std::collections::{BTreeMap, btree_map::Entry};

use super::plant_log::Channel;
use crate::{DataConfig, first_few::first_few, names::Chosen};

/// What is said of such channels that the study reads, unless a file has both; none of none.
pub(super) fn differing_in_case(channels: &[Channel], data: &DataConfig) -> Option<String> {
    let chosen = Chosen::of(data);
    let mut known: BTreeMap<String, &Channel> = BTreeMap::new();
    let mut pairs = Vec::new();
    for channel in channels.iter().filter(|channel| chosen.has(&channel.names())) {
        match known.entry(channel.name.to_lowercase()) {
            Entry::Vacant(new) => {
                new.insert(channel);
            }
            Entry::Occupied(first) => {
                let first = *first.get();
                let mut files = first.positions.keys();
                if !files.any(|file| channel.positions.contains_key(file)) {
                    pairs.push(format!("{:?} and {:?}", first.name, channel.name));
                }
            }
        }
    }
    let named = first_few(&pairs)?;
    Some(format!(
        "names of channels differ only in capital letters: {named}. If they are one channel, write its name alike in all files; else ignore this"
    ))
}
