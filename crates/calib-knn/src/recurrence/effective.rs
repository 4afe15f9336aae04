use calib_core::RowIndex;

use super::{
    exits::{Exits, left_out_of},
    graph::Graph,
    halt::Halt,
    lists::Lists,
    member_search::MemberSearch,
    tarjan::{ShrinkingGraph, Verdict},
};
use crate::{
    bits::Bits,
    distance::{squared, stored},
};

/// Number of preceding transitions whose lists are searched together with a row's own.
const BESIDE: u32 = 15;

/// The rule for which traps are left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rule {
    /// All traps, unless more than `bound` candidates are lost. Candidates at a standstill do not count, because the same state
    /// follows.
    All {
        /// Maximum number of candidates that may be lost.
        bound: usize,
    },
    /// Only traps in which every transition is at a standstill, so that nothing is lost.
    Still,
}

/// The graph of a member while closed classes are left out. Rows that contain a candidate that is left out are searched again when the
/// search reaches them.
pub(super) struct Effective<'a> {
    graph: &'a Graph<'a>,
    search: MemberSearch<'a>,
    rule: Rule,
    /// Number of transitions of the smallest class that is not a trap.
    enough: usize,
    /// The candidates that are left out of each member. Those of this member grow during the search.
    left_out: Vec<Bits>,
    /// Additional exclusions of single rows.
    exits: &'a Exits,
    lists: Lists,
    /// Number of candidates that are lost.
    lost: usize,
}

impl<'a> Effective<'a> {
    /// Creates the graph without the candidates that are left out so far.
    pub(super) fn new(
        graph: &'a Graph<'a>,
        search: MemberSearch<'a>,
        rule: Rule,
        enough: usize,
        left_out: Bits,
        exits: &'a Exits,
    ) -> Self {
        let lost = search.lost(left_out.iter());
        let left_out = search.of_member(left_out);
        let lists = Lists::default();
        Self { graph, search, rule, enough, left_out, exits, lists, lost }
    }

    /// Returns the candidates that are left out of the member.
    pub(super) fn into_left_out(mut self) -> Bits {
        std::mem::take(&mut self.left_out[self.search.member])
    }

    fn gone(&self) -> &Bits {
        &self.left_out[self.search.member]
    }

    /// Returns the nearest sources of the next state of `node`, without those in `left_out`, and the distances that tables store.
    fn searched_again(&mut self, node: u32) -> Result<Vec<(f32, u32)>, Halt> {
        let search = self.search;
        let row = search.next(node);
        let k = self.graph.k;
        let mut apart = Lists::default();
        let nearest = if self.exits.contains_key(&node) {
            let left_out = search.of_member(left_out_of(node, self.gone(), self.exits));
            apart.first(&search, &[row], k, &left_out)?.to_vec()
        } else {
            // Traps grow backwards in time, so the rows just before this one will probably be requested next.
            let before = (node.saturating_sub(BESIDE)..node).rev();
            let before = before.filter(|&node| self.graph.has(node)).map(|node| search.next(node));
            let rows: Vec<RowIndex> = std::iter::once(row).chain(before).collect();
            self.lists.first(&search, &rows, k, &self.left_out)?.to_vec()
        };
        if nearest.len() < k {
            return Err(Halt::Lost);
        }
        let Some(states) = search.sources.measured else {
            return Ok(nearest.into_iter().map(|(to, distance)| (distance, to)).collect());
        };
        let mut list: Vec<(f64, u32)> = nearest
            .into_iter()
            .map(|(to, _): (u32, f32)| {
                (squared(states.row(row.get()), states.row(search.source(to).get())), to)
            })
            .collect();
        list.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        Ok(list.into_iter().map(|(squared, to)| (stored(squared), to)).collect())
    }
}

impl ShrinkingGraph for Effective<'_> {
    fn edges(&mut self, node: u32, edges: &mut Vec<u32>) -> Result<(), Halt> {
        if self.graph.row(node).iter().all(|&to| !self.gone().contains(to)) {
            self.graph.edges(node, edges);
            return Ok(());
        }
        let (distances, nearest): (Vec<f32>, Vec<u32>) =
            self.searched_again(node)?.into_iter().unzip();
        let drawn = nearest.into_iter().zip(self.graph.weights.possible(&distances));
        edges.clear();
        edges.extend(drawn.filter(|(_, possible)| *possible).map(|(to, _)| to));
        Ok(())
    }

    fn is_left_out(&self, node: u32) -> bool {
        self.gone().contains(node)
    }

    fn judge(&mut self, class: &[u32]) -> Result<Verdict, Halt> {
        let lost = self.search.lost(class.iter().copied());
        if class.len() >= self.enough || (self.rule == Rule::Still && lost > 0) {
            return Ok(Verdict::Keep);
        }
        self.lost += lost;
        match self.rule {
            Rule::All { bound } if self.lost > bound => Err(Halt::Lost),
            _ => {
                self.left_out[self.search.member].extend(class.iter().copied());
                Ok(Verdict::LeaveOut)
            }
        }
    }
}
