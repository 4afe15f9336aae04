use calib_core::{Monitor, RowIndex, TransitionIndex};

use crate::{
    Exclusion, KnnError, PART_QUERIES,
    bits::Bits,
    index::{NeighborLists, Planned, Queries, Sources},
};

/// Searches the neighbours of a member's rows while candidates are left out, with the structure that found its table.
///
/// The leaf budget does not apply: repeated searches are exact, so that a result does not depend on the other queries of its band.
#[derive(Clone, Copy)]
pub(super) struct MemberSearch<'a> {
    pub(super) planned: &'a Planned<'a>,
    pub(super) sources: &'a Sources<'a>,
    pub(super) exclusion: Exclusion,
    pub(super) member: usize,
    pub(super) monitor: &'a dyn Monitor,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Distances {
    /// The distances of the search. Lists are in their order.
    Searched,
    /// The distances that tables store. Lists are in their order.
    Stored,
}

/// A monitor that forwards interruptions but no progress.
struct InterruptOnly<'a>(&'a dyn Monitor);

impl Monitor for InterruptOnly<'_> {
    fn begin(&self, _task: &str, _total: u64) {}

    fn advance(&self, _units: u64) {}

    fn interrupted(&self) -> bool {
        self.0.interrupted()
    }
}

impl MemberSearch<'_> {
    /// Returns the exclusions of all members, with `left_out` for this one, in the form that searches take.
    pub(super) fn of_member(&self, left_out: Bits) -> Vec<Bits> {
        let mut all = vec![Bits::default(); self.sources.blocks.members()];
        all[self.member] = left_out;
        all
    }

    /// Returns the row that transition `node` leads to.
    pub(super) fn next(&self, node: u32) -> RowIndex {
        self.sources.transitions.next(TransitionIndex(node))
    }

    /// Returns the row that transition `node` starts from.
    pub(super) fn source(&self, node: u32) -> RowIndex {
        self.sources.transitions.source(TransitionIndex(node))
    }

    /// Returns the state that the search uses for `row`.
    pub(super) fn state(&self, row: RowIndex) -> &[f32] {
        self.sources.states.row(row.get())
    }

    /// Whether queries of the member can find the transition that was recorded after `node`.
    pub(super) fn goes_on(&self, node: u32, left_out: &Bits) -> bool {
        let transitions = self.sources.transitions;
        transitions.starting_at(self.next(node)).is_some_and(|next| {
            self.sources.blocks.contains(self.member, next)
                && self.sources.candidates.contains(next.0)
                && !left_out.contains(next.0)
        })
    }

    /// Returns how many of these transitions are not at a standstill. At a standstill, a transition leads to the state that it starts from,
    /// and the transition recorded after it is a candidate.
    pub(super) fn lost(&self, nodes: impl Iterator<Item = u32>) -> usize {
        let nothing = Bits::default();
        nodes
            .filter(|&node| {
                let is_still = self.goes_on(node, &nothing)
                    && self.state(self.source(node)) == self.state(self.next(node));
                !is_still
            })
            .count()
    }

    /// Returns the number of the member's candidates.
    pub(super) fn candidates(&self) -> usize {
        self.sources.blocks.admissible(self.member, &(0..0), self.sources.candidates)
    }

    /// Calls `each` for each row with its number and the transitions and distances of its `k` nearest remaining candidates. Lists are
    /// shorter if there are fewer, and rows come in any order.
    pub(super) fn nearest(
        &self,
        rows: &[RowIndex],
        k: usize,
        exclusion: Exclusion,
        left_out: &[Bits],
        distances: Distances,
        mut each: impl FnMut(usize, &[u32], &[f32]),
    ) -> Result<(), KnnError> {
        let queries = Queries::rows(self.sources, rows, self.member, exclusion).without(left_out);
        let order = self.planned.index.order(&queries);
        for part in order.chunks(PART_QUERIES) {
            let mut found = NeighborLists::new(part.len(), queries.members(), k);
            self.planned.index.search(&queries, part, &mut found, &InterruptOnly(self.monitor))?;
            if distances == Distances::Stored {
                found.measure(&queries, part);
            }
            for (place, &query) in part.iter().enumerate() {
                let (neighbors, distances) = found.list(place, self.member);
                let length = neighbors.iter().take_while(|&&to| to != u32::MAX).count();
                each(query as usize, &neighbors[..length], &distances[..length]);
            }
        }
        Ok(())
    }
}
