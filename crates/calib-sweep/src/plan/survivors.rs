//! The settings that a race has left.

use std::collections::{BTreeMap, BTreeSet};

/// The settings that are left after each round of a race, for each sensor.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Survivors(pub(super) BTreeMap<String, Vec<BTreeSet<usize>>>);

impl Survivors {
    pub(super) fn rounds(&self, sensor: &str) -> &[BTreeSet<usize>] {
        self.0.get(sensor).map_or(&[], Vec::as_slice)
    }
}

/// The settings that are left before a unit.
pub(super) enum SurvivorsBefore<'s> {
    All,
    Some(&'s BTreeSet<usize>),
    /// Either one setting is left, so that the unit is not needed, or the settings are not known
    /// yet.
    OneOrUnknown,
}
