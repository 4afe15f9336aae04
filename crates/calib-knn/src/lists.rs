use calib_core::TransitionIndex;

use crate::{Queries, candidate_mask::CandidateMask};

/// A candidate source: squared distance, then row as the tie-break.
///
/// Transitions are numbered in the order of their source rows, so comparing transitions compares rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Candidate {
    /// Squared distance by the definition.
    pub(crate) squared: f64,
    /// The transition that starts from the source.
    pub(crate) transition: u32,
}

impl Candidate {
    pub(crate) const NONE: Self = Self { squared: f64::INFINITY, transition: u32::MAX };

    pub(crate) fn before(self, other: Self) -> bool {
        self.squared < other.squared
            || (self.squared == other.squared && self.transition < other.transition)
    }
}

/// The lists of one query during its search: of all sources, or of every class of them.
///
/// A radius is the squared distance beyond which no candidate can enter a list. A candidate at it may enter. It is `−∞` where no
/// list is requested.
pub(crate) trait Lists: Clone + Default + Send {
    /// Whether there are lists for every class of sources.
    const BY_CLASS: bool;

    /// Creates the empty lists that a query requests.
    fn requested(queries: &Queries<'_>, query: usize, k: usize) -> Self;

    /// Removes all candidates and keeps what is requested.
    fn clear(&mut self);

    /// Offers a candidate of a class to every requested member that can find it.
    fn offer(&mut self, class: usize, candidate: Candidate, findable: CandidateMask<'_>);

    /// Returns the largest radius of all lists.
    fn radius(&self) -> f64;

    /// Returns the largest radius of the lists of a class.
    fn radius_in(&self, class: usize) -> f64;

    /// Returns the length of a full list.
    fn k(&self) -> usize;

    /// Returns the members whose lists are requested.
    fn members(&self) -> &[usize];

    /// Returns all transitions that are in some list, and maybe others, with repetitions.
    fn all(&self) -> impl Iterator<Item = TransitionIndex> + '_;

    /// Calls `put` for every neighbour with the number of its list, its position there, and the candidate.
    fn each(&self, put: impl FnMut(usize, usize, Candidate));
}

/// The `k` nearest sources of one query in every member that the query belongs to.
///
/// One search serves all members: a candidate enters the list of each member that contains it.
#[derive(Clone, Debug, Default)]
pub(crate) struct MemberLists {
    k: usize,
    /// `k` candidates for each member, in order. Short lists end in [`Candidate::NONE`].
    candidates: Vec<Candidate>,
    /// The members whose lists are requested.
    wanted: Vec<usize>,
    /// The largest `k`-th squared distance over the requested members.
    radius: f64,
}

impl MemberLists {
    pub(crate) fn new(members: usize, k: usize) -> Self {
        Self {
            k,
            candidates: vec![Candidate::NONE; members * k],
            wanted: Vec::with_capacity(members),
            radius: f64::INFINITY,
        }
    }

    /// Removes all candidates and requests the lists of these members.
    pub(crate) fn reset(&mut self, wanted: impl Iterator<Item = usize>) {
        self.wanted.clear();
        self.wanted.extend(wanted);
        self.clear();
    }

    fn update_radius(&mut self) {
        self.radius = self
            .wanted
            .iter()
            .map(|member| self.candidates[(member + 1) * self.k - 1].squared)
            .fold(f64::NEG_INFINITY, f64::max);
    }

    /// Returns the neighbours found for `member`, nearest first: transition and squared distance.
    pub(crate) fn of(&self, member: usize) -> impl Iterator<Item = (TransitionIndex, f64)> + '_ {
        self.candidates[member * self.k..][..self.k]
            .iter()
            .filter(|candidate| candidate.transition != u32::MAX)
            .map(|candidate| (TransitionIndex(candidate.transition), candidate.squared))
    }
}

impl Lists for MemberLists {
    const BY_CLASS: bool = false;

    fn requested(queries: &Queries<'_>, query: usize, k: usize) -> Self {
        let mut lists = Self::new(queries.members(), k);
        lists.reset(queries.wanted(query));
        lists
    }

    fn clear(&mut self) {
        self.candidates.fill(Candidate::NONE);
        self.update_radius();
    }

    fn offer(&mut self, _: usize, candidate: Candidate, findable: CandidateMask<'_>) {
        if candidate.squared > self.radius {
            return;
        }
        let mut entered = false;
        for &member in &self.wanted {
            let list = &mut self.candidates[member * self.k..][..self.k];
            if !candidate.before(list[self.k - 1])
                || !findable.contains(member, candidate.transition)
            {
                continue;
            }
            let mut position = self.k - 1;
            while position > 0 && candidate.before(list[position - 1]) {
                list[position] = list[position - 1];
                position -= 1;
            }
            list[position] = candidate;
            entered = true;
        }
        if entered {
            self.update_radius();
        }
    }

    fn radius(&self) -> f64 {
        self.radius
    }

    fn radius_in(&self, _: usize) -> f64 {
        self.radius
    }

    fn k(&self) -> usize {
        self.k
    }

    fn members(&self) -> &[usize] {
        &self.wanted
    }

    fn all(&self) -> impl Iterator<Item = TransitionIndex> + '_ {
        let found = self.candidates.iter().filter(|candidate| candidate.transition != u32::MAX);
        found.map(|candidate| TransitionIndex(candidate.transition))
    }

    fn each(&self, mut put: impl FnMut(usize, usize, Candidate)) {
        for &member in &self.wanted {
            for (position, (TransitionIndex(transition), squared)) in self.of(member).enumerate() {
                put(member, position, Candidate { squared, transition });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use calib_core::{Segments, Transitions};

    use super::*;
    use crate::{Blocks, bits::Bits};

    /// Returns the transitions in a member's list.
    fn found(lists: &MemberLists, member: usize) -> Vec<u32> {
        lists.of(member).map(|(transition, _)| transition.0).collect()
    }

    #[test]
    fn a_candidate_enters_the_members_that_contain_it() {
        let transitions = Transitions::new(Segments::from_lengths([2; 6]).expect("valid"));
        let blocks = Blocks::new(&transitions, 3).expect("valid");
        let mut lists = MemberLists::new(3, 2);
        lists.reset([0, 2].into_iter());
        for (transition, squared) in [(0, 1.0), (3, 2.0), (5, 0.5), (2, 2.0), (1, 9.0), (4, 0.1)] {
            lists.offer(0, Candidate { squared, transition }, CandidateMask::new(&blocks, &[]));
        }
        assert_eq!(found(&lists, 0), [4, 5]);
        assert_eq!(found(&lists, 1), [] as [u32; 0]);
        // Transitions 2 and 3 tie: the earlier row wins.
        assert_eq!(found(&lists, 2), [0, 2]);
        assert_eq!(lists.radius(), 2.0);
    }

    #[test]
    fn what_is_left_out_enters_no_list() {
        let transitions = Transitions::new(Segments::from_lengths([2; 6]).expect("valid"));
        let blocks = Blocks::new(&transitions, 3).expect("valid");
        let left_out = [Bits::default(), Bits::of(6, [1])];
        let mut lists = MemberLists::new(3, 2);
        lists.reset(0..3);
        for transition in 0..6 {
            let candidate = Candidate { squared: 1.0, transition };
            lists.offer(0, candidate, CandidateMask::new(&blocks, &left_out));
        }
        let found = [0, 1, 2].map(|member| found(&lists, member));
        assert_eq!(found, [[2, 3], [0, 4], [0, 1]]);
    }
}
