//! Which values a race has left, and which units it therefore makes.

use std::collections::{BTreeMap, BTreeSet};

use super::{Plan, PlannedSensor};
use crate::{Unit, UnitResult};

/// The values that are left after each round of a race, for each sensor.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Survivors(BTreeMap<String, Vec<BTreeSet<usize>>>);

impl Survivors {
    pub(super) fn rounds(&self, sensor: &str) -> &[BTreeSet<usize>] {
        self.0.get(sensor).map_or(&[], Vec::as_slice)
    }
}

/// The values that are left before a unit.
pub(super) enum SurvivorsBefore<'s> {
    All,
    Some(&'s BTreeSet<usize>),
    /// They are one, so that the unit is not run, or not known yet.
    OneOrUnknown,
}

impl Plan<'_> {
    /// Decide what the results allow to decide; whether that was anything.
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

    /// The round of the race before that of a unit; none if it is made whatever happens.
    fn round_before(&self, unit: &Unit) -> Option<usize> {
        let race = &self.races.as_ref()?[self.group_of(&unit.sensor)];
        race.round(unit.environment, unit.run)?.checked_sub(1)
    }

    /// The values that are left before the round of a unit.
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

    /// Whether one value is left before the round of a unit.
    pub(super) fn is_spared(&self, unit: &Unit, survivors: &Survivors) -> bool {
        let rounds = survivors.rounds(&unit.sensor);
        self.round_before(unit)
            .is_some_and(|round: usize| rounds.iter().take(round + 1).any(|left| left.len() < 2))
    }
}
