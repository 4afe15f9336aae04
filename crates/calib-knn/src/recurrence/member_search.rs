use calib_core::{Monitor, RowIndex, TransitionIndex};

use crate::{
    Exclusion, KnnError, PART_QUERIES,
    bits::Bits,
    index::{NeighborLists, Planned, Queries, Sources},
};

/// Searches for what a member's transitions lead to where something is left out, with the structure that found its table.
///
/// A leaf budget does not count here: what is searched again is found exactly, so that it does not depend on its company.
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
    /// Those that were searched by, lists in their order.
    Searched,
    /// Those that tables hold, lists in their order.
    Stored,
}

/// Watches for interruptions alone: what is searched on the way is not counted.
struct InterruptOnly<'a>(&'a dyn Monitor);

impl Monitor for InterruptOnly<'_> {
    fn begin(&self, _task: &str, _total: u64) {}

    fn advance(&self, _units: u64) {}

    fn interrupted(&self) -> bool {
        self.0.interrupted()
    }
}

impl MemberSearch<'_> {
    /// What is left out of this member, as searches are told.
    pub(super) fn of_member(&self, left_out: Bits) -> Vec<Bits> {
        let mut all = vec![Bits::default(); self.sources.blocks.members()];
        all[self.member] = left_out;
        all
    }

    /// The row that transition `node` leads to.
    pub(super) fn next(&self, node: u32) -> RowIndex {
        self.sources.transitions.next(TransitionIndex(node))
    }

    /// The row that transition `node` starts from.
    pub(super) fn source(&self, node: u32) -> RowIndex {
        self.sources.transitions.source(TransitionIndex(node))
    }

    /// The state that is searched for from `row`.
    pub(super) fn state(&self, row: RowIndex) -> &[f32] {
        self.sources.states.row(row.get())
    }

    /// Whether what was recorded after `node` can be found by queries of the member.
    pub(super) fn goes_on(&self, node: u32, left_out: &Bits) -> bool {
        let transitions = self.sources.transitions;
        transitions.starting_at(self.next(node)).is_some_and(|next| {
            self.sources.blocks.contains(self.member, next)
                && self.sources.candidates.contains(next.0)
                && !left_out.contains(next.0)
        })
    }

    /// How many of these transitions do not stand still: those that do lead to the state that they start from, and what was recorded
    /// after them is a candidate.
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

    /// Number of the member's candidates.
    pub(super) fn candidates(&self) -> usize {
        self.sources.blocks.admissible(self.member, &(0..0), self.sources.candidates)
    }

    /// Show `each` of the rows by its number, and the `k` nearest to it of what is not left out: their transitions and distances. Lists are
    /// shorter where there are not as many, and come in any order of rows.
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
                queries.measure(part, &mut found);
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
