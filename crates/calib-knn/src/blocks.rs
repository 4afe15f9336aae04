use std::ops::Range;

use calib_core::{TransitionIndex, Transitions};

use crate::{KnnError, candidates::Candidates};

/// The leave-one-block-out split: which transitions each member of the ensemble contains.
///
/// The `t` transitions in time order are split into `B` contiguous blocks, block `b` being transitions
/// `⌊b·t/B⌋ .. ⌊(b+1)·t/B⌋`, so that sizes differ by at most one (the paper). The *rows* of a block are all
/// rows that its transitions touch. Member `m` contains every transition whose both end rows lie outside
/// the rows of block `m`. So member `m` lacks block `m`. It also lacks the transition just before the block
/// and the one just after it, where they share a row with the block. They share no row where a segment
/// ends.
///
/// ```
/// use calib_core::{Segments, Transitions};
/// use calib_knn::Blocks;
///
/// // One segment of nine rows: eight transitions, four blocks of two.
/// let transitions = Transitions::new(Segments::from_lengths([9]).unwrap());
/// let blocks = Blocks::new(&transitions, 4).unwrap();
/// assert_eq!(blocks.own(1), 2..4);
/// assert_eq!(blocks.dropped(1), 1..5); // 1 and 4 share rows 2 and 4 with block 1
/// assert_eq!(blocks.member_len(1), 4);
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Blocks {
    transitions: u32,
    own: Vec<Range<u32>>,
    dropped: Vec<Range<u32>>,
}

impl Blocks {
    /// Splits `transitions` into `members` blocks.
    ///
    /// # Errors
    /// Fewer than two members, or fewer transitions than members.
    pub fn new(transitions: &Transitions, members: usize) -> Result<Self, KnnError> {
        let count = transitions.len();
        if members < 2 {
            return Err(KnnError::TooFewMembers { members });
        }
        if count < members {
            return Err(KnnError::TooFewTransitions { transitions: count, members });
        }
        let bounds: Vec<u32> = (0..=members as u64)
            .map(|block| (block * count as u64 / members as u64) as u32)
            .collect();
        let own: Vec<Range<u32>> = bounds.windows(2).map(|pair| pair[0]..pair[1]).collect();
        let dropped = own
            .iter()
            .map(|block| {
                let start = block.start - u32::from(continues(transitions, block.start));
                start..block.end + u32::from(continues(transitions, block.end))
            })
            .collect();
        Ok(Self { transitions: count as u32, own, dropped })
    }

    /// Returns a single member that contains all `transitions`, for a search over everything.
    pub(crate) fn undivided(transitions: &Transitions) -> Self {
        let count = transitions.len() as u32;
        let own = 0..count;
        let dropped = count..count;
        Self { transitions: count, own: vec![own], dropped: vec![dropped] }
    }

    /// Returns the number of members, which is also the number of blocks.
    pub fn members(&self) -> usize {
        self.own.len()
    }

    /// Returns the number of transitions over all blocks.
    pub fn transitions(&self) -> usize {
        self.transitions as usize
    }

    /// Returns the transitions of block `block`.
    pub fn own(&self, block: usize) -> Range<u32> {
        self.own[block].clone()
    }

    /// Returns the transitions that member `member` lacks: its block and the adjacent transitions that
    /// share a row with it.
    pub fn dropped(&self, member: usize) -> Range<u32> {
        self.dropped[member].clone()
    }

    pub(crate) fn dropped_ref(&self, member: usize) -> &Range<u32> {
        &self.dropped[member]
    }

    /// Whether member `member` contains `transition`.
    pub fn contains(&self, member: usize, transition: TransitionIndex) -> bool {
        transition.0 < self.transitions && !self.dropped[member].contains(&transition.0)
    }

    /// Returns the members that lack `transition`, which are adjacent.
    pub(crate) fn lacking(&self, transition: u32) -> Range<usize> {
        let first = self.dropped.partition_point(|dropped| dropped.end <= transition);
        let from = self.dropped[first..].iter();
        first..first + from.take_while(|dropped| dropped.start <= transition).count()
    }

    /// Returns the number of transitions of member `member`.
    pub fn member_len(&self, member: usize) -> usize {
        self.transitions as usize - self.dropped[member].len()
    }

    /// Returns the `position`-th transition of member `member` in time order.
    ///
    /// # Panics
    /// If the member has no more than `position` transitions.
    pub fn nth(&self, member: usize, position: usize) -> TransitionIndex {
        assert!(position < self.member_len(member), "a position inside the member");
        let dropped = &self.dropped[member];
        if position < dropped.start as usize {
            TransitionIndex::new(position)
        } else {
            TransitionIndex::new(position + dropped.len())
        }
    }

    /// Returns the transitions of member `member` in time order.
    pub fn transitions_of(&self, member: usize) -> impl Iterator<Item = TransitionIndex> + use<> {
        let dropped = self.dropped(member);
        (0..dropped.start).chain(dropped.end..self.transitions).map(TransitionIndex)
    }

    /// Returns the block that contains `transition`.
    pub fn block_of(&self, transition: TransitionIndex) -> usize {
        self.own.partition_point(|block| block.end <= transition.0)
    }

    /// Returns the number of candidates of member `member` outside `forbidden`.
    pub(crate) fn admissible(
        &self,
        member: usize,
        forbidden: &Range<u32>,
        candidates: Candidates<'_>,
    ) -> usize {
        let dropped = &self.dropped[member];
        let both = forbidden.start.max(dropped.start)..forbidden.end.min(dropped.end);
        candidates.count(&(0..self.transitions)) + candidates.count(&both)
            - candidates.count(dropped)
            - candidates.count(forbidden)
    }
}

/// Whether the transition before `transition` leads to the row that it starts from.
fn continues(transitions: &Transitions, transition: u32) -> bool {
    transition > 0
        && (transition as usize) < transitions.len()
        && transitions.next(TransitionIndex(transition - 1))
            == transitions.source(TransitionIndex(transition))
}

#[cfg(test)]
mod tests {
    use calib_core::Segments;
    use proptest::prelude::*;

    use super::*;

    fn transitions(lengths: &[usize]) -> Transitions {
        Transitions::new(Segments::from_lengths(lengths.iter().copied()).expect("valid"))
    }

    #[test]
    fn neighbours_across_a_gap_stay() {
        // Transitions 0..3 in rows 0..4, transitions 3..6 in rows 4..8.
        let blocks = Blocks::new(&transitions(&[4, 4]), 2).expect("valid");
        assert_eq!((blocks.own(0), blocks.dropped(0)), (0..3, 0..3));
        assert_eq!((blocks.own(1), blocks.dropped(1)), (3..6, 3..6));
    }

    #[test]
    fn the_boundary_row_is_left_out() {
        let all = transitions(&[7]);
        let blocks = Blocks::new(&all, 3).expect("valid");
        assert_eq!([blocks.dropped(0), blocks.dropped(1), blocks.dropped(2)], [0..3, 1..5, 3..6]);
        assert_eq!(blocks.transitions_of(1).map(|t| t.0).collect::<Vec<_>>(), [0, 5]);
        assert_eq!(blocks.nth(1, 1), TransitionIndex(5));
        assert_eq!(blocks.block_of(TransitionIndex(3)), 1);
    }

    #[test]
    fn impossible_splits_are_refused() {
        let few = Blocks::new(&transitions(&[3]), 5).expect_err("two transitions");
        assert!(few.to_string().contains("2 transitions cannot be split into 5 blocks"));
        assert!(matches!(
            Blocks::new(&transitions(&[3]), 1),
            Err(KnnError::TooFewMembers { members: 1 })
        ));
    }

    proptest! {
        #[test]
        fn members_are_exactly_the_transitions_that_avoid_the_block(
            lengths in proptest::collection::vec(1_usize..9, 1..12),
            members in 2_usize..7,
            start in 0_u32..60, length in 0_u32..60,
        ) {
            let all = transitions(&lengths);
            prop_assume!(all.len() >= members);
            let blocks = Blocks::new(&all, members).expect("enough transitions");
            let sizes: Vec<usize> = (0..members).map(|b| blocks.own(b).len()).collect();
            prop_assert!(sizes.iter().max().expect("some") - sizes.iter().min().expect("some") <= 1);
            prop_assert_eq!(sizes.iter().sum::<usize>(), all.len());
            let forbidden = start.min(all.len() as u32)..(start + length).min(all.len() as u32);
            for member in 0..members {
                let rows: std::collections::BTreeSet<u32> = blocks
                    .own(member)
                    .flat_map(|i| [all.source(TransitionIndex(i)).0, all.next(TransitionIndex(i)).0])
                    .collect();
                let expected: Vec<u32> = (0..all.len() as u32)
                    .filter(|&i| {
                        let i = TransitionIndex(i);
                        !rows.contains(&all.source(i).0) && !rows.contains(&all.next(i).0)
                    })
                    .collect();
                for i in 0..all.len() as u32 {
                    let lacks = !blocks.contains(member, TransitionIndex(i));
                    prop_assert_eq!(blocks.lacking(i).contains(&member), lacks);
                }
                let got: Vec<u32> = blocks.transitions_of(member).map(|i| i.0).collect();
                prop_assert_eq!(&got, &expected);
                prop_assert_eq!(blocks.member_len(member), expected.len());
                for (position, &i) in expected.iter().enumerate() {
                    prop_assert_eq!(blocks.nth(member, position).0, i);
                    prop_assert!(blocks.contains(member, TransitionIndex(i)));
                }
                let left = expected.iter().filter(|i| !forbidden.contains(i)).count();
                prop_assert_eq!(blocks.admissible(member, &forbidden, Candidates::Every(1)), left);
            }
        }
    }
}
