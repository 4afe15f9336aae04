//! Models without traps.
//!
//! The *graph* of a member has its transitions for nodes and an edge from each to every neighbour that a step can draw there. A *closed
//! class* is a set of transitions that lead to each other and to nothing else (a terminal strongly connected component): a walk that
//! enters it never leaves it. At a dead end of the record (the last row before a gap, or beside a block that is left out) the nearest
//! sources are the rows just before it, so that three of them are a closed class already.
//!
//! A closed class of fewer than a tenth of the member's candidates is a *trap*. Its transitions are left out, as candidates only: their own rows of
//! the table stay. Rows of the table that held them are searched again among what remains, which may close other classes, until none is a trap.
//! The order does not matter: what is left out changes only rows that hold it, and no row of another closed class does, so that it is still one
//! afterwards. Hence [`settle`](tarjan::settle) takes them as it comes by them.
//!
//! If more than a tenth of the candidates would be lost so, or there is hardly a loop to begin with, only traps in a standstill are left out (its first rows are everybody's
//! neighbours, and lead to each other; the last ones, which lead on, take their place), and all others are given exits instead: one row
//! of each, a dead end if there is one, is searched again among what lies outside; again and again, until none is a trap. Rows of a
//! standstill but its last do not count as lost. Where that takes too many exits, the table stays as it was found.

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

/// A closed class of fewer than one of this many candidates is a trap, and no more of them may be lost (our choice): what a walk
/// of a member should be able to visit is most of it, and what is a tenth of a log is a regime of the plant rather than a dead end.
const SHARE: usize = 10;
/// Sizes of classes that are told.
const TOLD: usize = 10;

/// Closed classes of a member.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ClosedClasses {
    /// How many there are; at least one.
    pub count: usize,
    /// Sizes of the ten largest in transitions, the largest first.
    pub largest: Vec<usize>,
    /// Transitions of all of them.
    pub transitions: usize,
    /// How many are traps: of fewer than a tenth of the member's candidates.
    pub traps: usize,
}

/// What was done so that no walk of a member is trapped.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Recurrence {
    /// Transitions of the member that can be neighbours.
    pub candidates: usize,
    /// Closed classes of the nearest neighbours as they were found.
    pub before: ClosedClasses,
    /// Closed classes of the tables.
    pub after: ClosedClasses,
    /// Candidates that are left out for all queries.
    pub left_out: usize,
    /// Those of them that are lost: not counting rows of a standstill that are followed by the same state.
    pub lost: usize,
    /// Rows of the table that lead out of a trap.
    pub exits: usize,
}

/// Why closed classes cannot all be dealt with.
#[derive(Debug)]
enum Halt {
    /// Too many candidates are lost, some query has too few left, or too many exits do not lead out.
    Lost,
    Error(KnnError),
}

impl<E: Into<KnnError>> From<E> for Halt {
    fn from(error: E) -> Self {
        Self::Error(error.into())
    }
}

impl Halt {
    /// What went wrong where nothing is left out.
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

/// Where walks of a member end: its traps if it has any, or else its closed classes.
#[derive(Clone, Debug)]
pub struct Ends(Bits);

impl Ends {
    /// Whether a walk that draws `transition` has come to its end.
    pub fn contains(&self, transition: TransitionIndex) -> bool {
        self.0.contains(transition.0)
    }
}

/// What was made of a member, and what was found.
pub(crate) struct MemberResult {
    pub(crate) left_out: LeftOut,
    pub(crate) recurrence: Recurrence,
    pub(crate) ends: Ends,
}

/// A table while it is made: neighbours and distances.
pub(crate) type Filling = (Scratch<u32>, Scratch<f32>);

/// How the tables of a model were found.
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
    /// Leave out of the tables of all members what walks would be trapped in; says for each member what, and what was found.
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

    /// What walks are trapped in, of tables that stay as they were found.
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
        // One after the other: where nothing returns, each takes memory for all of its transitions.
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

/// The closed classes of a member with so many candidates, under the weights that its steps are drawn with, and where its walks end.
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
