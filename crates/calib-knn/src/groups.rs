use std::ops::Range;

use calib_core::Monitor;
use rayon::prelude::*;

use crate::{
    KnnError, Lists, Sources, candidate_mask::CandidateMask, classes::Classes, lists::Candidate,
};

/// Sources between two checks for an interruption.
const CHUNK: usize = 1 << 14;

/// The distinct source states, each with the transitions that start from it. Transitions of different classes are not in one group.
///
/// A plant at a standstill repeats a state for hours. Searching only distinct states keeps bucket trees
/// balanced, and a search does not visit thousands of equal candidates.
#[derive(Debug)]
pub(crate) struct Groups {
    /// Transitions group by group, ascending in each. Groups are in the order of their first transition.
    transitions: Vec<u32>,
    /// Start of each group in `transitions`, and the end of the last.
    starts: Vec<u32>,
    /// One row of each state: that of its first transition. It is stored here so that a search reads it
    /// together with the start.
    rows: Vec<u32>,
}

impl Groups {
    /// Groups the sources by equal coordinates; `-0` equals `0`. Progress counts sources.
    ///
    /// # Errors
    /// If the monitor interrupts.
    pub(crate) fn new(sources: &Sources<'_>, monitor: &dyn Monitor) -> Result<Self, KnnError> {
        let states = sources.states.as_slice();
        let columns = sources.columns();
        let rows = sources.transitions.sources();
        let state =
            |transition: u32| &states[rows[transition as usize] as usize * columns..][..columns];
        let candidates = sources.candidates;
        let mut hashed = vec![(0, 0); sources.candidates_len()];
        hashed.par_chunks_mut(CHUNK).enumerate().for_each(|(number, chunk)| {
            if monitor.interrupted() {
                return;
            }
            let first = (number * CHUNK) as u32;
            for (number, hashed) in (first..).zip(&mut *chunk) {
                let transition = candidates.nth(number);
                *hashed = (hash(state(transition)), transition);
            }
            monitor.advance(chunk.len() as u64);
        });
        monitor.check()?;
        hashed.par_sort_unstable();
        let classes = sources.classes;
        // The first member of a group identifies it. Equal hashes almost always mean equal states.
        let mut named: Vec<(u32, u32)> = Vec::with_capacity(hashed.len());
        for run in hashed.chunk_by(|a, b| a.0 == b.0) {
            let mut firsts: Vec<u32> = Vec::new();
            for &(_, transition) in run {
                let first = firsts.iter().copied().find(|&first| {
                    state(first) == state(transition)
                        && classes.class(first) == classes.class(transition)
                });
                if first.is_none() {
                    firsts.push(transition);
                }
                named.push((first.unwrap_or(transition), transition));
            }
        }
        drop(hashed);
        named.par_sort_unstable();
        let mut starts = Vec::new();
        for (position, pair) in named.iter().enumerate() {
            if pair.0 == pair.1 {
                starts.push(position as u32);
            }
        }
        starts.push(named.len() as u32);
        let transitions = named.iter().map(|&(_, transition)| transition).collect();
        Ok(Self::with_rows(transitions, starts, rows))
    }

    /// Returns one group per transition, for searches that do not benefit from grouping equal states.
    pub(crate) fn singletons(sources: &Sources<'_>) -> Self {
        let count = sources.candidates_len() as u32;
        let candidates = sources.candidates;
        let transitions = (0..count).map(|number| candidates.nth(number)).collect();
        Self::with_rows(transitions, (0..=count).collect(), sources.transitions.sources())
    }

    fn with_rows(transitions: Vec<u32>, starts: Vec<u32>, sources: &[u32]) -> Self {
        let firsts = starts[..starts.len() - 1].iter();
        let rows = firsts.map(|&start| sources[transitions[start as usize] as usize]).collect();
        Self { transitions, starts, rows }
    }

    /// Returns the same groups in another order, so that groups that are searched together are adjacent.
    pub(crate) fn in_order(&self, order: &[u32]) -> Self {
        let mut sorted = Self {
            transitions: Vec::with_capacity(self.transitions.len()),
            starts: Vec::with_capacity(self.starts.len()),
            rows: order.iter().map(|&group| self.rows[group as usize]).collect(),
        };
        for &group in order {
            sorted.starts.push(sorted.transitions.len() as u32);
            sorted.transitions.extend(self.transitions(group as usize));
        }
        sorted.starts.push(sorted.transitions.len() as u32);
        sorted
    }

    /// Returns the same groups in the order of their first transitions, so that a scan reads states
    /// sequentially.
    pub(crate) fn in_time(&self) -> Self {
        let mut order: Vec<u32> = (0..self.len() as u32).collect();
        order.par_sort_unstable_by_key(|&group| self.transitions(group as usize)[0]);
        self.in_order(&order)
    }

    /// Returns the same groups in the order of their classes, each in the order of time, and the end of each class.
    pub(crate) fn in_classes(&self, classes: Classes<'_>) -> (Self, Vec<usize>) {
        let mut order: Vec<u32> = (0..self.len() as u32).collect();
        order.par_sort_unstable_by_key(|&group| {
            (self.class(group, classes), self.transitions(group as usize)[0])
        });
        let ends = (0..classes.count())
            .map(|class| order.partition_point(|&group| self.class(group, classes) <= class))
            .collect();
        (self.in_order(&order), ends)
    }

    /// Returns the number of distinct states.
    pub(crate) fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Returns the transitions that start from state `group`, ascending.
    pub(crate) fn transitions(&self, group: usize) -> &[u32] {
        &self.transitions[self.starts[group] as usize..self.starts[group + 1] as usize]
    }

    /// Returns the class of the transitions that start from state `group`.
    #[inline]
    pub(crate) fn class(&self, group: u32, classes: Classes<'_>) -> usize {
        // Without classes, a search need not read the group.
        if classes.are_given() { classes.class(self.transitions(group as usize)[0]) } else { 0 }
    }

    /// Returns a row of state `group`.
    pub(crate) fn row(&self, group: usize) -> usize {
        self.rows[group] as usize
    }

    /// Offers the transitions of `group` outside `forbidden`, all of one class and at squared distance `squared`.
    pub(crate) fn offer(
        &self,
        group: usize,
        squared: f64,
        forbidden: &Range<u32>,
        class: usize,
        lists: &mut impl Lists,
        findable: CandidateMask<'_>,
    ) {
        let transitions = self.transitions(group);
        let wanted = lists.members().len();
        if transitions.len() <= 2 * lists.k() * wanted {
            for &transition in transitions {
                if !forbidden.contains(&transition) {
                    lists.offer(class, Candidate { squared, transition }, findable);
                }
            }
            return;
        }
        // In a large group only the first k admissible transitions of a member can enter its list.
        let mut firsts = Vec::with_capacity(lists.k() * wanted);
        for &member in lists.members() {
            let admissible = Admissible { transitions, forbidden, findable, member };
            firsts.extend(admissible.take(lists.k()));
        }
        firsts.sort_unstable();
        firsts.dedup();
        for transition in firsts {
            lists.offer(class, Candidate { squared, transition }, findable);
        }
    }
}

/// Returns a hash of a state. Equal coordinates have equal hashes; `-0` equals `0`.
pub(crate) fn hash(state: &[f32]) -> u64 {
    state.iter().fold(0_u64, |hash, &value| {
        // Multiply and rotate. Any function of the values is correct.
        (hash ^ u64::from((value + 0.0).to_bits()))
            .wrapping_mul(0x9e37_79b9_7f4a_7c15)
            .rotate_left(29)
    })
}

/// Iterates over the transitions that a member's query can find, ascending. It skips runs of the others.
struct Admissible<'a> {
    transitions: &'a [u32],
    forbidden: &'a Range<u32>,
    findable: CandidateMask<'a>,
    member: usize,
}

impl Admissible<'_> {
    /// Returns the end of the run of transitions that cannot be found, if `transition` lies in one.
    fn beyond(&self, transition: u32) -> Option<u32> {
        if self.forbidden.contains(&transition) {
            return Some(self.forbidden.end);
        }
        self.findable.beyond(self.member, transition)
    }
}

impl Iterator for Admissible<'_> {
    type Item = u32;

    fn next(&mut self) -> Option<u32> {
        loop {
            let (&first, rest) = self.transitions.split_first()?;
            if let Some(end) = self.beyond(first) {
                let beyond = self.transitions.partition_point(|&t| t < end);
                self.transitions = &self.transitions[beyond..];
            } else {
                self.transitions = rest;
                return Some(first);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use calib_core::{Segments, Silent, States, Transitions};

    use super::*;
    use crate::{Blocks, MemberLists, bits::Bits};

    #[test]
    fn equal_states_share_a_group() {
        let states = States::new(vec![1.0, 0.0, 1.0, 2.0, -0.0, 0.0, 9.0], 7, 1).expect("valid");
        let transitions = Transitions::new(Segments::from_lengths([7]).expect("valid"));
        let blocks = Blocks::new(&transitions, 2).expect("valid");
        let sources = Sources::new(&states, &transitions, &blocks).expect("valid");
        let groups = Groups::new(&sources, &Silent).expect("not interrupted");
        let all: Vec<&[u32]> = (0..groups.len()).map(|g| groups.transitions(g)).collect();
        assert_eq!(all, [&[0, 2][..], &[1, 4, 5], &[3]]);
        assert_eq!([groups.row(0), groups.row(1), groups.row(2)], [0, 1, 3]);
        let sorted = groups.in_order(&[2, 0, 1]);
        let all: Vec<&[u32]> = (0..3).map(|g| sorted.transitions(g)).collect();
        assert_eq!(all, [&[3][..], &[0, 2], &[1, 4, 5]]);
        assert_eq!([sorted.row(0), sorted.row(1), sorted.row(2)], [3, 0, 1]);
        let again = sorted.in_time();
        let all: Vec<&[u32]> = (0..3).map(|g| again.transitions(g)).collect();
        assert_eq!(all, [&[0, 2][..], &[1, 4, 5], &[3]]);
    }

    /// Returns the transitions in a member's list.
    fn found(lists: &MemberLists, member: usize) -> Vec<u32> {
        lists.of(member).map(|(transition, _)| transition.0).collect()
    }

    #[test]
    fn large_groups_offer_the_first_admissible_rows() {
        let states = States::new(vec![0.5; 1000], 1000, 1).expect("valid");
        let transitions = Transitions::new(Segments::from_lengths([1000]).expect("valid"));
        let blocks = Blocks::new(&transitions, 5).expect("valid");
        let sources = Sources::new(&states, &transitions, &blocks).expect("valid");
        let groups = Groups::new(&sources, &Silent).expect("not interrupted");
        assert_eq!(groups.len(), 1);
        let mut lists = MemberLists::new(5, 2);
        lists.reset([0, 3].into_iter());
        groups.offer(0, 0.0, &(1..700), 0, &mut lists, CandidateMask::new(&blocks, &[]));
        assert_eq!(found(&lists, 0), [700, 701]);
        assert_eq!(found(&lists, 3), [0, blocks.dropped(3).end]);
        let left_out =
            [Bits::of(999, 690..800), Bits::default(), Bits::default(), Bits::of(999, [0])];
        lists.reset([0, 3].into_iter());
        groups.offer(0, 0.0, &(1..700), 0, &mut lists, CandidateMask::new(&blocks, &left_out));
        assert_eq!(found(&lists, 0), [800, 801]);
        let end = blocks.dropped(3).end;
        assert_eq!(found(&lists, 3), [end, end + 1]);
    }
}
