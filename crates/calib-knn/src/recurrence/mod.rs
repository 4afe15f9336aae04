//! Removal of traps, so that rollouts of a model cannot be caught.
//!
//! The *graph* of a member has its transitions as nodes. An edge leads from a transition to every neighbour that a step can draw there. A
//! *closed class* is a terminal strongly connected component: its transitions lead to each other and to nothing else. A rollout that enters
//! it never leaves it. At a dead end of the record (the last row before a gap, or beside a block that is left out) the nearest sources are
//! the rows just before it. Three of them already form a closed class.
//!
//! A closed class of fewer than a tenth of the member's candidates is a *trap*. Its transitions are left out as candidates only; their own
//! rows of the table stay. Rows of the table that contained them are searched again among the remaining candidates. This may close other
//! classes, so the search continues until no trap remains. The order does not matter. Leaving transitions out changes only rows that
//! contain them. No row of another closed class does, so that class stays closed. Hence [`settle`](tarjan::settle) removes traps in the
//! order in which it finds them.
//!
//! There are two cases in which this fails: more than a tenth of the candidates would be lost, or the log hardly revisits its states. Then
//! only traps in a standstill are left out. The first rows of a standstill are neighbours of many rows and lead to each other; its last
//! rows, which lead on, take their place. All other traps are given exits. One row of each, a dead end if there is one, is searched again
//! among the candidates outside. This repeats until no trap remains. Rows of a standstill but its last do not count as lost. If too many
//! exits are needed, the table stays as it was found.

mod anchor;
mod classes;
mod effective;
mod exits;
mod graph;
mod lists;
mod member;
mod member_search;
mod reaching;
#[cfg(test)]
mod shapes;
mod tarjan;

use calib_core::{Monitor, TransitionIndex};
use calib_files::{Scratch, ScratchPlace};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    Exclusion, KnnError, KnnModel, LeftOut, Weights,
    bits::Bits,
    index::{Planned, Sources},
};
use anchor::Anchor;
use classes::{Classes, closed};
use graph::Graph;
use member::{Member, Survey};

/// A closed class of fewer than one in `SHARE` of the candidates is a trap, and no more candidates than that may be lost (our choice). A
/// rollout should be able to visit most of its member. A tenth of a log is a regime of the plant rather than a dead end.
const SHARE: usize = 10;
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

/// The reason why traps cannot be removed.
#[derive(Debug)]
enum Halt {
    /// Too many candidates are lost, some query has too few left, or too many exits were needed.
    Lost,
    Error(KnnError),
}

impl<E: Into<KnnError>> From<E> for Halt {
    fn from(error: E) -> Self {
        Self::Error(error.into())
    }
}

impl Halt {
    /// Returns the error of a search in which nothing is left out.
    fn into_error(self) -> KnnError {
        match self {
            Self::Error(error) => error,
            Self::Lost => unreachable!("nothing is left out"),
        }
    }
}

impl ClosedClasses {
    fn of(classes: &Classes, enough: usize) -> Self {
        Self {
            count: classes.sizes.len(),
            largest: classes.sizes.iter().copied().take(TOLD).collect(),
            transitions: classes.sizes.iter().sum(),
            traps: classes.traps(enough),
        }
    }
}

/// The transitions where rollouts of a member end: those of its traps, or of its closed classes if it has no trap.
#[derive(Clone, Debug)]
pub struct Ends(Bits);

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

/// A table under construction: neighbours and distances.
pub(crate) type Filling = (Scratch<u32>, Scratch<f32>);

/// The search that found the tables of a model, and its settings.
#[derive(Clone, Copy)]
pub(crate) struct TableSearch<'a> {
    pub(crate) planned: &'a Planned<'a>,
    pub(crate) sources: &'a Sources<'a>,
    pub(crate) k: usize,
    pub(crate) exclusion: Exclusion,
    pub(crate) weights: Weights,
    pub(crate) place: &'a ScratchPlace,
    pub(crate) monitor: &'a dyn Monitor,
}

impl TableSearch<'_> {
    /// Removes the traps from the tables of all members. Returns for each member what was left out and found.
    ///
    /// Progress counts members, then rows that are searched again.
    ///
    /// # Errors
    /// If there is no place for the arrays, or the monitor interrupts.
    pub(crate) fn without_traps(
        self,
        tables: &mut [Filling],
    ) -> Result<Vec<MemberResult>, KnnError> {
        self.survey(tables)?
            .into_iter()
            .zip(tables)
            .map(|((member, survey), table)| member.remove_traps(table, &survey))
            .collect()
    }

    /// Finds the traps in tables that stay as they were found.
    ///
    /// # Errors
    /// If there is no place for the arrays, or the monitor interrupts.
    pub(crate) fn as_found(self, tables: &[Filling]) -> Result<Vec<MemberResult>, KnnError> {
        Ok(self
            .survey(tables)?
            .into_iter()
            .map(|(member, survey)| member.as_found(&survey))
            .collect())
    }

    fn survey(&self, tables: &[Filling]) -> Result<Vec<(Member<'_>, Survey)>, KnnError> {
        self.monitor.begin("closed classes", tables.len() as u64);
        // One member at a time: if states hardly recur, each takes memory for all of its transitions.
        tables
            .iter()
            .enumerate()
            .map(|(number, table)| {
                let member = Member::new(*self, number);
                let survey = member.survey(table)?;
                self.monitor.advance(1);
                Ok((member, survey))
            })
            .collect()
    }
}

/// Returns the closed classes of a member with this many candidates, under the weights that its steps use, and where its rollouts end.
///
/// # Errors
/// If the monitor interrupts.
pub fn closed_classes(
    model: &KnnModel,
    member: usize,
    weights: Weights,
    candidates: usize,
    monitor: &dyn Monitor,
) -> Result<(ClosedClasses, Ends), KnnError> {
    let table = model.table(member);
    let dropped = model.blocks().dropped(member);
    let graph = Graph::new(table.neighbors(), table.distances(), table.k(), dropped, weights);
    let enough = candidates.div_ceil(SHARE);
    let place = ScratchPlace::Memory;
    let anchor = Anchor::find(&graph, enough, &place, monitor)?;
    let classes = closed(&graph, &anchor, enough, &place, monitor)?;
    Ok((ClosedClasses::of(&classes, enough), Ends(classes.ends)))
}
