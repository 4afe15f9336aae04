use std::{
    collections::{BTreeMap, HashMap},
    ops::Range,
};

use calib_core::RowIndex;

use super::{
    graph::Graph,
    halt::Halt,
    member_search::{Distances, MemberSearch},
    tarjan::{ShrinkingGraph, Verdict},
};
use crate::bits::Bits;

/// The exits: rows that lead out of a trap, each with the runs of transitions that they must not lead to.
pub(super) type Exits = BTreeMap<u32, Vec<Range<u32>>>;

/// Returns the candidates that are left out for row `node` of a member.
pub(super) fn left_out_of(node: u32, left_out: &Bits, exits: &Exits) -> Bits {
    let mut all = left_out.clone();
    for run in exits.get(&node).into_iter().flatten() {
        all.extend(run.clone());
    }
    all
}

/// The graph of a member while traps are given exits.
pub(super) struct Leading<'a> {
    pub(super) graph: &'a Graph<'a>,
    pub(super) search: MemberSearch<'a>,
    /// Number of transitions of the smallest class that is not a trap.
    pub(super) enough: usize,
    pub(super) left_out: &'a Bits,
    pub(super) exits: Exits,
    /// The current rows of the exits: neighbours and distances.
    pub(super) rows: HashMap<u32, (Vec<u32>, Vec<f32>)>,
    /// How many more times a trap may be given an exit.
    pub(super) most: usize,
}

impl Leading<'_> {
    /// Returns the row of a trap that becomes its exit: the dead end that is nearest to any candidate outside. If the trap has no
    /// dead end, all its transitions are considered.
    fn exit_of(&self, trap: &[u32]) -> Result<u32, Halt> {
        let ends = trap.iter().copied().filter(|&node| !self.search.goes_on(node, self.left_out));
        let mut among: Vec<u32> = ends.collect();
        if among.is_empty() {
            among = trap.to_vec();
        }
        let mut outside = self.left_out.clone();
        outside.extend(trap.iter().copied());
        let (old, new): (Vec<u32>, Vec<u32>) =
            among.into_iter().partition(|node| self.exits.contains_key(node));
        let mut best = self.nearest(&new, outside.clone())?;
        for node in old {
            let all = left_out_of(node, &outside, &self.exits);
            best = nearer(best, self.nearest(&[node], all)?);
        }
        best.map(|(_, node)| node).ok_or(Halt::Lost)
    }

    /// Returns the row with the nearest candidate that is not left out, and that distance.
    fn nearest(&self, nodes: &[u32], left_out: Bits) -> Result<Option<(f32, u32)>, Halt> {
        let rows: Vec<RowIndex> = nodes.iter().map(|&node| self.search.next(node)).collect();
        let left_out = self.search.of_member(left_out);
        let mut best = None;
        let exclusion = self.search.exclusion;
        let searched = Distances::Searched;
        self.search.nearest(&rows, 1, exclusion, &left_out, searched, |row, _, distances| {
            best = nearer(best, distances.first().map(|&distance| (distance, nodes[row])));
        })?;
        Ok(best)
    }

    /// Searches the neighbours of an exit.
    fn search_row(&mut self, node: u32) -> Result<(), Halt> {
        let left_out = self.search.of_member(left_out_of(node, self.left_out, &self.exits));
        let row = [self.search.next(node)];
        let k = self.graph.k;
        let exclusion = self.search.exclusion;
        let mut found = (Vec::new(), Vec::new());
        self.search.nearest(&row, k, exclusion, &left_out, Distances::Stored, |_, to, far| {
            found = (to.to_vec(), far.to_vec());
        })?;
        if found.0.len() < k {
            return Err(Halt::Lost);
        }
        self.rows.insert(node, found);
        Ok(())
    }
}

/// Returns the nearer of two rows, ties by row.
fn nearer(a: Option<(f32, u32)>, b: Option<(f32, u32)>) -> Option<(f32, u32)> {
    match (a, b) {
        (Some(a), Some(b)) => Some(if b < a { b } else { a }),
        (a, b) => a.or(b),
    }
}

impl ShrinkingGraph for Leading<'_> {
    fn edges(&mut self, node: u32, edges: &mut Vec<u32>) -> Result<(), Halt> {
        if let Some((neighbors, distances)) = self.rows.get(&node) {
            let drawn = neighbors.iter().zip(self.graph.weights.possible(distances));
            edges.clear();
            edges.extend(drawn.filter(|(_, possible)| *possible).map(|(&to, _)| to));
        } else {
            self.graph.edges(node, edges);
        }
        Ok(())
    }

    fn is_left_out(&self, node: u32) -> bool {
        self.left_out.contains(node)
    }

    /// Turns one row into an exit. From now on it leads to no transition of this trap, nor to those that it was already led out of.
    fn judge(&mut self, class: &[u32]) -> Result<Verdict, Halt> {
        if class.len() >= self.enough {
            return Ok(Verdict::Keep);
        }
        self.most = self.most.checked_sub(1).ok_or(Halt::Lost)?;
        let exit = self.exit_of(class)?;
        let mut barred = left_out_of(exit, &Bits::new(self.left_out.len()), &self.exits);
        barred.extend(class.iter().copied());
        self.exits.insert(exit, barred.runs().collect());
        self.search_row(exit)?;
        Ok(Verdict::AddExit)
    }
}
