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
mod halt;
mod lists;
mod member;
mod member_search;
mod reaching;
mod results;
#[cfg(test)]
mod shapes;
mod table_search;
mod tarjan;

use std::ops::Range;

use calib_core::Monitor;
use calib_files::ScratchPlace;

use crate::{
    KnnError, Weights,
    table::{Filling, NeighborTable},
};
use anchor::Anchor;
use classes::{SHARE, closed};
use graph::Graph;
use member::{Member, Survey};
use results::MemberResult;
pub use results::{ClosedClasses, Ends, Recurrence};
pub(crate) use table_search::TableSearch;

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

/// Returns the closed classes of a member that lacks the transitions `dropped` and has this many candidates, under the weights that its
/// steps use, and where its rollouts end.
///
/// # Errors
/// If the monitor interrupts.
pub(crate) fn closed_classes(
    table: &NeighborTable,
    dropped: Range<u32>,
    weights: Weights,
    candidates: usize,
    monitor: &dyn Monitor,
) -> Result<(ClosedClasses, Ends), KnnError> {
    let graph = Graph::new(table.neighbors(), table.distances(), table.k(), dropped, weights);
    let enough = candidates.div_ceil(SHARE);
    let place = ScratchPlace::Memory;
    let anchor = Anchor::find(&graph, enough, &place, monitor)?;
    let classes = closed(&graph, &anchor, enough, &place, monitor)?;
    Ok((ClosedClasses::of(&classes, enough), Ends(classes.ends)))
}
