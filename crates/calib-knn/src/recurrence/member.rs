use std::collections::HashMap;

use calib_files::Scratch;
use rayon::prelude::*;

use super::{
    anchor::Anchor,
    classes::{Classes, SHARE, closed},
    effective::{Effective, Rule},
    exits::{Exits, Leading, left_out_of},
    graph::Graph,
    halt::Halt,
    member_search::{Distances, MemberSearch},
    results::{ClosedClasses, Ends, MemberResult, Recurrence},
    table_search::TableSearch,
    tarjan::settle,
};
use crate::{KnnError, LeftOut, PART_QUERIES, bits::Bits, table::Filling};

/// A member hardly revisits its states if no probed component contains one in this many candidates (our choice).
const LOOP: usize = 100;
/// Maximum and minimum number of times that traps are given exits. A log that needs more never revisits its states. In between, the
/// limit is a share of the candidates. On a ramp each exit adds `k` to a trap, and the limit is reached before the trap is a tenth of
/// the ramp. (Our choice; twelve days of tests of a plant, 9,400 transitions that hardly meet, take about 100.)
const EXITS: [usize; 2] = [1000, 16];
const RAMP: usize = 16;
/// Maximum number of rounds in which the rest is checked for traps again. One is enough, unless table distances differ from those of
/// the search.
const ROUNDS: usize = 10;
/// The closed classes of a member, and the anchor that found them.
pub(super) struct Survey {
    anchor: Anchor,
    pub(super) classes: Classes,
}

/// A member whose traps should be removed.
pub(super) struct Member<'a> {
    tables: TableSearch<'a>,
    search: MemberSearch<'a>,
    /// Number of its transitions that can be neighbours.
    pub(super) candidates: usize,
    /// Number of transitions of the smallest closed class that is not a trap.
    pub(super) enough: usize,
}

impl<'a> Member<'a> {
    pub(super) fn new(tables: TableSearch<'a>, member: usize) -> Self {
        let TableSearch { planned, sources, exclusion, monitor, .. } = tables;
        let search = MemberSearch { planned, sources, exclusion, member, monitor };
        let candidates = search.candidates();
        Self { tables, search, candidates, enough: candidates.div_ceil(SHARE) }
    }

    fn graph<'t>(&self, table: &'t Filling) -> Graph<'t> {
        let dropped = self.tables.sources.blocks.dropped(self.search.member);
        Graph::new(&table.0, &table.1, self.tables.k, dropped, self.tables.weights)
    }

    pub(super) fn survey(&self, table: &Filling) -> Result<Survey, KnnError> {
        let graph = self.graph(table);
        let TableSearch { place, monitor, .. } = self.tables;
        let anchor = Anchor::find(&graph, self.enough, place, monitor)?;
        let classes = self.closed(&graph, &anchor)?;
        Ok(Survey { anchor, classes })
    }

    fn closed(&self, graph: &Graph<'_>, anchor: &Anchor) -> Result<Classes, KnnError> {
        closed(graph, anchor, self.enough, self.tables.place, self.tables.monitor)
    }

    /// Removes the traps of the table, or gives them exits. If neither works, the table stays as it was found.
    pub(super) fn remove_traps(
        &self,
        table: &mut Filling,
        survey: &Survey,
    ) -> Result<MemberResult, KnnError> {
        if survey.classes.traps(self.enough) == 0 {
            return Ok(self.as_found(survey));
        }
        let found = self.copy(table)?;
        match self.without_traps(table, survey) {
            Ok(recurrent) => Ok(recurrent),
            Err(Halt::Error(error)) => Err(error),
            Err(Halt::Lost) => {
                table.0.copy_from_slice(&found.0);
                table.1.copy_from_slice(&found.1);
                Ok(self.as_found(survey))
            }
        }
    }

    /// Describes a table that stays as it was found.
    pub(super) fn as_found(&self, survey: &Survey) -> MemberResult {
        let classes = ClosedClasses::of(&survey.classes, self.enough);
        let before = classes.clone();
        let after = classes;
        let candidates = self.candidates;
        let recurrence = Recurrence { candidates, before, after, ..Recurrence::default() };
        let ends = Ends(survey.classes.ends.clone());
        MemberResult { left_out: LeftOut::default(), recurrence, ends }
    }

    fn copy(&self, table: &Filling) -> Result<Filling, KnnError> {
        let len = table.0.len();
        let place = self.tables.place;
        let mut copy = (Scratch::zeroed(len, place)?, Scratch::zeroed(len, place)?);
        copy.0.copy_from_slice(&table.0);
        copy.1.copy_from_slice(&table.1);
        Ok(copy)
    }

    fn without_traps(&self, table: &mut Filling, survey: &Survey) -> Result<MemberResult, Halt> {
        let mut anchor = survey.anchor.clone();
        let mut left_out = Bits::new(table.0.len() / self.tables.k);
        let mut exits = Exits::new();
        for _ in 0..ROUNDS {
            // If the log hardly revisits its states, each removed trap creates the next one without end.
            let all = if anchor.component * LOOP < self.candidates {
                Err(Halt::Lost)
            } else {
                let bound = Rule::All { bound: self.candidates / SHARE };
                self.leave_out(table, bound, &left_out, &exits, &anchor)
            };
            match all {
                Ok(more) => left_out = more,
                Err(Halt::Error(error)) => return Err(error.into()),
                Err(Halt::Lost) => {
                    left_out = self.leave_out(table, Rule::Still, &left_out, &exits, &anchor)?;
                    self.search_again(table, &left_out, &exits)?;
                    exits = self.add_exits(table, &left_out, exits, &anchor)?;
                }
            }
            self.search_again(table, &left_out, &exits)?;
            let classes;
            (anchor, classes) = self.survey_again(table, anchor)?;
            if classes.traps(self.enough) == 0 {
                let recurrence = Recurrence {
                    candidates: self.candidates,
                    before: ClosedClasses::of(&survey.classes, self.enough),
                    after: ClosedClasses::of(&classes, self.enough),
                    left_out: left_out.count(),
                    lost: self.search.lost(left_out.iter()),
                    exits: exits.len(),
                };
                let left_out = LeftOut::new(left_out, exits);
                return Ok(MemberResult { left_out, recurrence, ends: Ends(classes.ends) });
            }
        }
        Err(Halt::Lost)
    }

    fn survey_again(&self, table: &Filling, anchor: Anchor) -> Result<(Anchor, Classes), KnnError> {
        let graph = self.graph(table);
        let TableSearch { place, monitor, .. } = self.tables;
        let anchor = anchor.in_graph(&graph, self.enough, place, monitor)?;
        let classes = self.closed(&graph, &anchor)?;
        Ok((anchor, classes))
    }

    /// Returns the transitions that may not lead to a permanent class, and those that certainly do.
    fn unsettled(&self, graph: &Graph<'_>, left_out: &Bits, anchor: &Anchor) -> (Bits, Bits) {
        // A transition of a large component is never in a trap, whatever is left out. So all transitions that lead to it are settled.
        let settled = if anchor.component >= self.enough {
            anchor.reaching.clone()
        } else {
            Bits::new(graph.len())
        };
        (graph.all().without(&settled).without(left_out), settled)
    }

    /// Returns the candidates that are left out by this rule, including those in `left_out`.
    fn leave_out(
        &self,
        table: &Filling,
        rule: Rule,
        left_out: &Bits,
        exits: &Exits,
        anchor: &Anchor,
    ) -> Result<Bits, Halt> {
        let graph = self.graph(table);
        let (nodes, mut settled) = self.unsettled(&graph, left_out, anchor);
        let left_out = left_out.clone();
        let mut graph = Effective::new(&graph, self.search, rule, self.enough, left_out, exits);
        settle(&nodes, &mut settled, &mut graph, self.tables.place, self.tables.monitor)?;
        Ok(graph.into_left_out())
    }

    /// Gives exits to all traps of the table.
    fn add_exits(
        &self,
        table: &mut Filling,
        left_out: &Bits,
        exits: Exits,
        anchor: &Anchor,
    ) -> Result<Exits, Halt> {
        let graph = self.graph(table);
        let (nodes, mut settled) = self.unsettled(&graph, left_out, anchor);
        let [most, least] = EXITS;
        let search = self.search;
        let enough = self.enough;
        let k = self.tables.k;
        let most = (self.candidates / (RAMP * k)).clamp(least, most);
        let rows = HashMap::new();
        let mut leading = Leading { graph: &graph, search, enough, left_out, exits, rows, most };
        settle(&nodes, &mut settled, &mut leading, self.tables.place, self.tables.monitor)?;
        let exits = leading.exits;
        let rows = leading.rows;
        for (node, (neighbors, distances)) in rows {
            let start = node as usize * k;
            table.0[start..start + k].copy_from_slice(&neighbors);
            table.1[start..start + k].copy_from_slice(&distances);
        }
        Ok(exits)
    }

    /// Searches the rows of the table again that contain a candidate that is left out.
    fn search_again(
        &self,
        table: &mut Filling,
        left_out: &Bits,
        exits: &Exits,
    ) -> Result<(), Halt> {
        let rows = table.0.par_chunks_exact(self.tables.k).enumerate();
        let rows: Vec<u32> = rows
            .filter(|(_, row)| row.iter().any(|&to| left_out.contains(to)))
            .map(|(number, _)| number as u32)
            .collect();
        let (exit, plain): (Vec<u32>, Vec<u32>) =
            rows.into_iter().partition(|node| exits.contains_key(node));
        if !plain.is_empty() {
            self.tables.monitor.begin("rows that led into traps", plain.len() as u64);
        }
        for part in plain.chunks(PART_QUERIES) {
            self.put(table, part, left_out.clone())?;
            self.tables.monitor.advance(part.len() as u64);
        }
        exit.into_iter()
            .try_for_each(|node| self.put(table, &[node], left_out_of(node, left_out, exits)))
    }

    /// Stores the nearest remaining candidates in these rows of the table.
    fn put(&self, table: &mut Filling, nodes: &[u32], left_out: Bits) -> Result<(), Halt> {
        let rows: Vec<_> = nodes.iter().map(|&node| self.search.next(node)).collect();
        let left_out = self.search.of_member(left_out);
        let k = self.tables.k;
        let mut fewest = usize::MAX;
        let stored = Distances::Stored;
        let exclusion = self.search.exclusion;
        self.search.nearest(&rows, k, exclusion, &left_out, stored, |row, to, far| {
            fewest = fewest.min(to.len());
            if to.len() == k {
                let start = nodes[row] as usize * k;
                table.0[start..start + k].copy_from_slice(to);
                table.1[start..start + k].copy_from_slice(far);
            }
        })?;
        if fewest < k { Err(Halt::Lost) } else { Ok(()) }
    }
}
