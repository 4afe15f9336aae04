//! The settings that a race has left, and the units that it therefore needs.

use std::collections::{BTreeMap, BTreeSet};

use super::{Plan, PlannedSensor};
use crate::{Unit, UnitResult};

/// The settings that are left after each round of a race, for each sensor.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Survivors(BTreeMap<String, Vec<BTreeSet<usize>>>);

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

impl Plan<'_> {
    /// Decides the rounds whose results are complete. Returns whether it decided any.
    pub(super) fn decide(
        &self,
        survivors: &mut Survivors,
        found: &BTreeMap<Unit, UnitResult>,
    ) -> bool {
        let Some(races) = &self.races else { return false };
        let mut decided = false;
        for PlannedSensor { name, group, .. } in &self.sensors {
            let after = races[*group].survivors(name, found);
            decided |= after.len() > survivors.rounds(name).len();
            survivors.0.insert(name.clone(), after);
        }
        decided
    }

    /// Returns the race round before that of a unit, or `None` if the unit is always run.
    fn round_before(&self, unit: &Unit) -> Option<usize> {
        let race = &self.races.as_ref()?[self.group_of(&unit.sensor)];
        race.round(unit.environment, unit.run)?.checked_sub(1)
    }

    /// Returns the settings that are left before the round of a unit.
    pub(super) fn left_before<'s>(
        &self,
        unit: &Unit,
        survivors: &'s Survivors,
    ) -> SurvivorsBefore<'s> {
        let Some(round) = self.round_before(unit) else { return SurvivorsBefore::All };
        let left = survivors.rounds(&unit.sensor).get(round);
        left.filter(|_| !self.is_spared(unit, survivors))
            .map_or(SurvivorsBefore::OneOrUnknown, SurvivorsBefore::Some)
    }

    /// Whether a unit is not needed because one setting is left before its round.
    pub(super) fn is_spared(&self, unit: &Unit, survivors: &Survivors) -> bool {
        let rounds = survivors.rounds(&unit.sensor);
        self.round_before(unit)
            .is_some_and(|round: usize| rounds.iter().take(round + 1).any(|left| left.len() < 2))
    }
}
