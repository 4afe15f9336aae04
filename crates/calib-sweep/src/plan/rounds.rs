//! The rounds of a race: what they leave, and the units that are therefore needed.

use std::collections::BTreeMap;

use super::{
    Plan, PlannedSensor,
    survivors::{Survivors, SurvivorsBefore},
};
use crate::{Unit, UnitResult};

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
