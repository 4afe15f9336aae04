use std::ops::Range;

use calib_core::TransitionIndex;

use crate::{Blocks, bits::Bits};

/// The sources that queries of each member can find: the member's transitions without those in `left_out`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CandidateMask<'a> {
    blocks: &'a Blocks,
    /// The candidates that are left out of each member. Members beyond the last leave nothing out.
    left_out: &'a [Bits],
}

impl<'a> CandidateMask<'a> {
    /// Combines the transitions of these blocks with what is left out.
    pub(crate) fn new(blocks: &'a Blocks, left_out: &'a [Bits]) -> Self {
        Self { blocks, left_out }
    }

    pub(crate) fn members(self) -> usize {
        self.blocks.members()
    }

    pub(crate) fn contains(self, member: usize, transition: u32) -> bool {
        self.blocks.contains(member, TransitionIndex(transition))
            && !self.left_out.get(member).is_some_and(|left_out| left_out.contains(transition))
    }

    /// Returns the members that lack `transition`, which are adjacent.
    pub(crate) fn lacking(self, transition: u32) -> Range<usize> {
        debug_assert!(self.left_out.is_empty(), "searches by class leave nothing out");
        self.blocks.lacking(transition)
    }

    /// Returns the end of the run of transitions that queries of `member` cannot find, if `transition` lies in
    /// one.
    pub(crate) fn beyond(self, member: usize, transition: u32) -> Option<u32> {
        let dropped: &Range<u32> = self.blocks.dropped_ref(member);
        if dropped.contains(&transition) {
            return Some(dropped.end);
        }
        let end = self.left_out.get(member)?.first_absent(transition);
        (end > transition).then_some(end)
    }
}
