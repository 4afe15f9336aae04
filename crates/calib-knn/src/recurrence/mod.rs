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
//! afterwards. Hence [`settle`](settle::settle) takes them as it comes by them.
//!
//! If more than a tenth of the candidates would be lost so, or there is hardly a loop to begin with, only traps in a standstill are left out (its first rows are everybody's
//! neighbours, and lead to each other; the last ones, which lead on, take their place), and all others are given exits instead: one row
//! of each, a dead end if there is one, is searched again among what lies outside; again and again, until none is a trap. Rows of a
//! standstill but its last do not count as lost.

mod again;
mod classes;
mod effective;
mod exits;
mod graph;
mod lists;
mod settle;

use std::collections::HashMap;

use calib_core::{Monitor, TransitionIndex};
use calib_files::{Scratch, ScratchPlace};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::{
    Exclusion, KnnError, KnnModel, LeftOut, PART_QUERIES, Weights,
    bits::Bits,
    index::{Planned, Sources},
};
use again::{Again, Distances};
use classes::{Anchor, Classes, closed};
use effective::{Effective, Rule};
use exits::{Exits, Leading, left_out_of};
use graph::Graph;
use settle::settle;

/// A closed class of fewer than one of this many candidates is a trap, and no more of them may be lost (our choice): what a walk
/// of a member should be able to visit is most of it, and what is a tenth of a log is a regime of the plant rather than a dead end.
const SHARE: usize = 10;
/// A member hardly returns to where it was if no loop that is looked at holds one of this many candidates (our choice).
const LOOP: usize = 100;
/// Times that traps are given exits, at most and at least: where it takes more, the log never returns to where it was. In between it is
/// a share of the candidates that a ramp, of which each exit adds `k` to a trap, exceeds before the trap is a tenth of it. (Our choice;
/// twelve days of tests of a plant, 9,400 transitions that hardly meet, take about 100.)
const EXITS: [usize; 2] = [1000, 16];
const RAMP: usize = 16;
/// Times that what remains is looked at for traps again. Once is enough, unless distances are not those that are searched by.
const ROUNDS: usize = 10;
/// Sizes of classes that are told.
const TOLD: usize = 10;

/// Closed classes of a member.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
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
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
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
    /// Some query has too few candidates left.
    Short { candidates: usize },
    /// Too many candidates are lost, or too many exits do not lead out.
    Lost,
    /// Something else.
    Error(KnnError),
}

impl From<KnnError> for Halt {
    fn from(error: KnnError) -> Self {
        Self::Error(error)
    }
}

impl From<calib_files::FileError> for Halt {
    fn from(error: calib_files::FileError) -> Self {
        Self::Error(error.into())
    }
}

impl Halt {
    /// What went wrong where nothing is left out.
    fn into_error(self) -> KnnError {
        match self {
            Self::Error(error) => error,
            Self::Short { .. } | Self::Lost => unreachable!("nothing is left out"),
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
pub(crate) struct Recurrent {
    pub(crate) left_out: LeftOut,
    pub(crate) recurrence: Recurrence,
    pub(crate) ends: Ends,
}

/// A table while it is made: neighbours and distances.
pub(crate) type Filling = (Scratch<u32>, Scratch<f32>);

/// How the tables of a model were found.
#[derive(Clone, Copy)]
pub(crate) struct Made<'a> {
    pub(crate) planned: &'a Planned<'a>,
    pub(crate) sources: &'a Sources<'a>,
    pub(crate) k: usize,
    pub(crate) exclusion: Exclusion,
    pub(crate) weights: Weights,
    pub(crate) place: &'a ScratchPlace,
    pub(crate) monitor: &'a dyn Monitor,
}

impl Made<'_> {
    /// Leave out of the tables of all members what walks would be trapped in; says for each member what, and what was found.
    ///
    /// Progress counts members, then rows that are searched again.
    ///
    /// # Errors
    /// [`KnnError::NeverReturns`] for a member in which nearly nothing can be returned to; if there is no place for the
    /// arrays, or the monitor interrupts.
    pub(crate) fn without_traps(self, tables: &mut [Filling]) -> Result<Vec<Recurrent>, KnnError> {
        let untrap = |((member, survey), table): ((Member<'_>, Survey), &mut Filling)| {
            member.untrap(table, survey)
        };
        self.survey(tables)?.into_iter().zip(tables).map(untrap).collect()
    }

    /// What walks are trapped in, of tables that stay as they were found.
    ///
    /// # Errors
    /// If there is no place for the arrays, or the monitor interrupts.
    pub(crate) fn as_found(self, tables: &[Filling]) -> Result<Vec<Recurrent>, KnnError> {
        let as_found = |(member, survey): (Member<'_>, Survey)| {
            let classes = ClosedClasses::of(&survey.classes, member.enough);
            let (before, after) = (classes.clone(), classes);
            let candidates = member.candidates;
            let recurrence = Recurrence { candidates, before, after, ..Recurrence::default() };
            Recurrent { left_out: LeftOut::default(), recurrence, ends: Ends(survey.classes.ends) }
        };
        Ok(self.survey(tables)?.into_iter().map(as_found).collect())
    }

    fn survey(&self, tables: &[Filling]) -> Result<Vec<(Member<'_>, Survey)>, KnnError> {
        self.monitor.begin("closed classes", tables.len() as u64);
        let survey = |(number, table): (usize, &Filling)| {
            let member = Member::new(*self, number);
            let survey = member.survey(table)?;
            self.monitor.advance(1);
            Ok((member, survey))
        };
        tables.par_iter().enumerate().map(survey).collect()
    }
}

/// Closed classes of a member, and how they were found.
struct Survey {
    anchor: Anchor,
    classes: Classes,
}

/// One member whose walks should not be trapped.
struct Member<'a> {
    made: Made<'a>,
    again: Again<'a>,
    /// Its transitions that can be neighbours.
    candidates: usize,
    /// Transitions of the smallest closed class that is no trap.
    enough: usize,
}

impl<'a> Member<'a> {
    fn new(made: Made<'a>, member: usize) -> Self {
        let Made { planned, sources, exclusion, monitor, .. } = made;
        let again = Again { planned, sources, exclusion, member, monitor };
        let candidates = again.candidates();
        Self { made, again, candidates, enough: candidates.div_ceil(SHARE) }
    }

    fn graph<'t>(&self, table: &'t Filling) -> Graph<'t> {
        let dropped = self.made.sources.blocks().dropped(self.again.member);
        Graph::new(&table.0, &table.1, self.made.k, dropped, self.made.weights)
    }

    fn survey(&self, table: &Filling) -> Result<Survey, KnnError> {
        let graph = self.graph(table);
        let anchor = Anchor::find(&graph, self.enough, self.made.monitor)?;
        let classes = self.closed(&graph, &anchor)?;
        Ok(Survey { anchor, classes })
    }

    fn closed(&self, graph: &Graph<'_>, anchor: &Anchor) -> Result<Classes, KnnError> {
        closed(graph, anchor, self.enough, self.made.place, self.made.monitor)
    }

    /// Leave traps out of the table, or lead walks out of them.
    fn untrap(&self, table: &mut Filling, survey: Survey) -> Result<Recurrent, KnnError> {
        let before = ClosedClasses::of(&survey.classes, self.enough);
        let (mut anchor, mut classes) = (survey.anchor, survey.classes);
        let (mut left_out, mut exits) = (Bits::new(table.0.len() / self.made.k), Exits::new());
        let mut rounds = 0..ROUNDS;
        while classes.traps(self.enough) > 0 {
            if rounds.next().is_none() {
                return Err(self.never_returns());
            }
            // Where hardly anything returns, one trap opens the next one for ever.
            let all = if anchor.component * LOOP < self.candidates {
                Err(Halt::Lost)
            } else {
                let bound = Rule::All { bound: self.candidates / SHARE };
                self.leave_out(table, bound, &left_out, &exits, &anchor)
            };
            match all {
                Ok(more) => left_out = more,
                Err(Halt::Error(error)) => return Err(error),
                Err(Halt::Lost | Halt::Short { .. }) => {
                    left_out = self
                        .leave_out(table, Rule::Still, &left_out, &exits, &anchor)
                        .map_err(|halt| self.error(halt))?;
                    self.search_again(table, &left_out, &exits)?;
                    exits = self
                        .lead_out(table, &left_out, exits, &anchor)
                        .map_err(|halt| self.error(halt))?;
                }
            }
            self.search_again(table, &left_out, &exits)?;
            (anchor, classes) = self.survey_again(table, anchor)?;
        }
        let recurrence = Recurrence {
            candidates: self.candidates,
            before,
            after: ClosedClasses::of(&classes, self.enough),
            left_out: left_out.count(),
            lost: self.again.lost(left_out.iter()),
            exits: exits.len(),
        };
        let left_out = LeftOut::new(left_out, exits);
        Ok(Recurrent { left_out, recurrence, ends: Ends(classes.ends) })
    }

    fn survey_again(&self, table: &Filling, anchor: Anchor) -> Result<(Anchor, Classes), KnnError> {
        let graph = self.graph(table);
        let anchor = anchor.in_graph(&graph, self.enough, self.made.monitor)?;
        let classes = self.closed(&graph, &anchor)?;
        Ok((anchor, classes))
    }

    /// All transitions of which it is not known whether they lead to a class that stays, and those of which it is.
    fn unsettled(&self, graph: &Graph<'_>, left_out: &Bits, anchor: &Anchor) -> (Bits, Bits) {
        // A transition of a large component is in no trap, whatever is left out, so that all that leads there stays.
        let settled = if anchor.component >= self.enough {
            anchor.reaching.clone()
        } else {
            Bits::new(graph.len())
        };
        (graph.all().without(&settled).without(left_out), settled)
    }

    /// What is left out by this rule, with what is already.
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
        let mut graph = Effective::new(&graph, self.again, rule, self.enough, left_out, exits);
        settle(&nodes, &mut settled, &mut graph, self.made.place, self.made.monitor)?;
        Ok(graph.into_left_out())
    }

    /// Give exits to all traps of the table.
    fn lead_out(
        &self,
        table: &mut Filling,
        left_out: &Bits,
        exits: Exits,
        anchor: &Anchor,
    ) -> Result<Exits, Halt> {
        let graph = self.graph(table);
        let (nodes, mut settled) = self.unsettled(&graph, left_out, anchor);
        let [most, least] = EXITS;
        let (again, enough, k) = (self.again, self.enough, self.made.k);
        let most = (self.candidates / (RAMP * k)).clamp(least, most);
        let rows = HashMap::new();
        let mut leading = Leading { graph: &graph, again, enough, left_out, exits, rows, most };
        settle(&nodes, &mut settled, &mut leading, self.made.place, self.made.monitor)?;
        let (exits, rows) = (leading.exits, leading.rows);
        for (node, (neighbors, distances)) in rows {
            let start = node as usize * k;
            table.0[start..start + k].copy_from_slice(&neighbors);
            table.1[start..start + k].copy_from_slice(&distances);
        }
        Ok(exits)
    }

    /// Search the rows of the table again that hold what is left out.
    fn search_again(
        &self,
        table: &mut Filling,
        left_out: &Bits,
        exits: &Exits,
    ) -> Result<(), KnnError> {
        let holds = |row: &[u32]| row.iter().any(|&to| left_out.contains(to));
        let rows = table.0.par_chunks_exact(self.made.k).enumerate();
        let rows: Vec<u32> =
            rows.filter(|(_, row)| holds(row)).map(|(number, _)| number as u32).collect();
        let (exit, plain): (Vec<u32>, Vec<u32>) =
            rows.into_iter().partition(|node| exits.contains_key(node));
        if !plain.is_empty() {
            self.made.monitor.begin("rows that led into traps", plain.len() as u64);
        }
        for part in plain.chunks(PART_QUERIES) {
            self.put(table, part, left_out.clone())?;
            self.made.monitor.advance(part.len() as u64);
        }
        exit.into_iter()
            .try_for_each(|node| self.put(table, &[node], left_out_of(node, left_out, exits)))
    }

    /// Put the nearest of what is not left out into these rows of the table.
    fn put(&self, table: &mut Filling, nodes: &[u32], left_out: Bits) -> Result<(), KnnError> {
        let rows: Vec<_> = nodes.iter().map(|&node| self.again.next(node)).collect();
        let left_out = self.again.of_member(left_out);
        let (k, mut fewest) = (self.made.k, usize::MAX);
        let stored = Distances::Stored;
        self.again.nearest(&rows, k, self.again.exclusion, &left_out, stored, |row, to, far| {
            fewest = fewest.min(to.len());
            if to.len() == k {
                let start = nodes[row] as usize * k;
                table.0[start..start + k].copy_from_slice(to);
                table.1[start..start + k].copy_from_slice(far);
            }
        })?;
        if fewest < k { Err(self.error(Halt::Short { candidates: fewest })) } else { Ok(()) }
    }

    fn never_returns(&self) -> KnnError {
        KnnError::NeverReturns { member: self.again.member }
    }

    fn error(&self, halt: Halt) -> KnnError {
        let member = self.again.member;
        match halt {
            Halt::Error(error) => error,
            Halt::Lost => self.never_returns(),
            Halt::Short { candidates } => {
                KnnError::TooFewCandidates { member, candidates, k: self.made.k }
            }
        }
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
    let graph = Graph::of(model.table(member), model.blocks().dropped(member), weights);
    let enough = candidates.div_ceil(SHARE);
    let anchor = Anchor::find(&graph, enough, monitor)?;
    let classes = closed(&graph, &anchor, enough, &ScratchPlace::Memory, monitor)?;
    Ok((ClosedClasses::of(&classes, enough), Ends(classes.ends)))
}
