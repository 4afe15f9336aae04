use calib_core::TransitionIndex;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::classes::Classes;
use crate::{LeftOut, bits::Bits};

/// Maximum number of class sizes that are reported.
const TOLD: usize = 10;

/// Closed classes of an ensemble member.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ClosedClasses {
    /// Number of closed classes; at least one.
    pub count: usize,
    /// Sizes of the ten largest classes in transitions, the largest first.
    pub largest: Vec<usize>,
    /// Number of transitions in all classes.
    pub transitions: usize,
    /// Number of classes that are traps, which have fewer than a tenth of the ensemble member's candidates.
    pub traps: usize,
}

impl ClosedClasses {
    /// Describes the classes of a graph. Those of at least `enough` transitions are not traps.
    pub(super) fn of(classes: &Classes, enough: usize) -> Self {
        Self {
            count: classes.sizes.len(),
            largest: classes.sizes.iter().copied().take(TOLD).collect(),
            transitions: classes.sizes.iter().sum(),
            traps: classes.traps(enough),
        }
    }
}

/// Result of removing the traps of an ensemble member, so that no rollout is trapped.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Recurrence {
    /// Transitions of the ensemble member that can be neighbours.
    pub candidates: usize,
    /// Closed classes before the removal, with the nearest neighbours as found.
    pub before: ClosedClasses,
    /// Closed classes after the removal, in the tables.
    pub after: ClosedClasses,
    /// Candidates that no query has as neighbours any more.
    pub left_out: usize,
    /// Candidates lost by the removal: those left out, without rows of a standstill that are followed by the same state.
    pub lost: usize,
    /// Table rows that were given an exit from a trap.
    pub exits: usize,
}

/// The transitions where rollouts of a member end: those of its traps, or of its closed classes if it has no trap.
#[derive(Clone, Debug)]
pub struct Ends(pub(super) Bits);

impl Ends {
    /// Whether a rollout that draws `transition` has reached its end.
    pub fn contains(&self, transition: TransitionIndex) -> bool {
        self.0.contains(transition.0)
    }
}

/// The result for one member: exclusions, statistics and ends.
pub(crate) struct MemberResult {
    pub(crate) left_out: LeftOut,
    pub(crate) recurrence: Recurrence,
    pub(crate) ends: Ends,
}
