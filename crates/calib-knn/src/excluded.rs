use std::{collections::BTreeMap, ops::Range};

use crate::bits::Bits;

/// Candidates that queries of a member do not find, so that no rollout is trapped among them.
///
/// Most are left out for all queries. Where that would cost too many candidates, some are left out only for single rows of
/// the table, the exits. An exit is a dead end whose own neighbours would lead back into the trap for ever.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LeftOut {
    for_all: Bits,
    exits: BTreeMap<u32, Vec<Range<u32>>>,
}

impl LeftOut {
    /// Combines the candidates that are left out for all queries with the additional ones of single rows.
    pub(crate) fn new(for_all: Bits, exits: BTreeMap<u32, Vec<Range<u32>>>) -> Self {
        Self { for_all, exits }
    }

    /// Whether nothing is left out.
    pub fn is_empty(&self) -> bool {
        self.for_all.is_empty() && self.exits.is_empty()
    }

    /// Returns how many candidates are left out for all queries.
    pub fn len(&self) -> usize {
        self.for_all.count()
    }

    /// Whether `transition` is left out for all queries.
    pub fn contains(&self, transition: u32) -> bool {
        self.for_all.contains(transition)
    }

    /// Returns the runs of transitions that are left out for all queries, in order.
    pub fn runs(&self) -> impl Iterator<Item = Range<u32>> + '_ {
        self.for_all.runs()
    }

    /// Returns the rows with additional exclusions. Each has the runs of transitions that its list may not contain, in order.
    pub fn exits(&self) -> impl Iterator<Item = (u32, &[Range<u32>])> {
        self.exits.iter().map(|(&row, runs)| (row, &runs[..]))
    }

    /// Whether row `row` of the table may not contain `transition`.
    pub(crate) fn bars(&self, row: u32, transition: u32) -> bool {
        self.for_all.contains(transition)
            || self
                .exits
                .get(&row)
                .is_some_and(|runs| runs.iter().any(|run| run.contains(&transition)))
    }

    /// Returns the candidates that are left out for all queries, in the form that searches take.
    pub(crate) fn for_all(&self) -> &Bits {
        &self.for_all
    }
}
