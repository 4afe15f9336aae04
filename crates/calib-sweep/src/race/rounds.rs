//! The assignment of runs to race rounds.

use std::{collections::BTreeMap, ops::Range};

use crate::EnvironmentId;

/// One run in an environment.
pub(super) type Run = (EnvironmentId, usize);

/// The streams that a race compares settings on: runs in ensemble members, and windows of the replayed log.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RacedStreams {
    /// Numbers of the ensemble members.
    pub(crate) members: Vec<usize>,
    /// Runs per member.
    pub(crate) runs: usize,
    /// Windows of the log.
    pub(crate) windows: usize,
}

impl RacedStreams {
    /// Divides the streams into rounds. The first round has N / 2^⌈log₂ values⌉ of the N streams, rounded up, and at
    /// least two. Each later round has as many streams as all rounds before it. So all rounds take the same work when
    /// half of the settings are dropped after each.
    pub(super) fn rounds(&self, values: usize) -> Rounds {
        let all = self.spread();
        let halvings = values.max(1).next_power_of_two();
        let mut until = all.len().div_ceil(halvings).max(2);
        let mut rounds = Vec::new();
        let mut from = 0;
        while from < all.len() {
            let end = until.min(all.len());
            rounds.push(all[from..end].to_vec());
            (from, until) = (end, 2 * until);
        }
        Rounds::new(rounds)
    }

    /// Returns all streams in a balanced order. Every prefix has members and windows in proportion, except that the
    /// first two streams are one of each. The windows of every prefix are spread over the whole log.
    fn spread(&self) -> Vec<Run> {
        let members = (0..self.runs).flat_map(|run| {
            self.members.iter().map(move |&member| (EnvironmentId::Member(member), run))
        });
        let windows = far_apart(self.windows).map(|window| (EnvironmentId::LogReplay, window));
        let mut placed: Vec<(f64, Run)> = placed(members, self.members.len() * self.runs)
            .chain(placed(windows, self.windows))
            .collect();
        // A stable sort: members come first where places are equal.
        placed.sort_by(|a, b| a.0.total_cmp(&b.0));
        placed.into_iter().map(|(_, run)| run).collect()
    }
}

/// Returns `count` runs with their places in `[0, 1)`.
fn placed(runs: impl Iterator<Item = Run>, count: usize) -> impl Iterator<Item = (f64, Run)> {
    runs.enumerate().map(move |(number, run)| (number as f64 / count as f64, run))
}

/// Returns the numbers below `count` in bit-reversed order, so that every prefix is spread over all of them.
fn far_apart(count: usize) -> impl Iterator<Item = usize> {
    let all = count.next_power_of_two();
    let bits = all.trailing_zeros();
    (0..all)
        .map(
            move |number| if bits == 0 { 0 } else { number.reverse_bits() >> (usize::BITS - bits) },
        )
        .filter(move |&number| number < count)
}

/// The runs of each round, in a fixed order.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Rounds {
    runs: Vec<Vec<Run>>,
    round_of: BTreeMap<Run, usize>,
}

impl Rounds {
    fn new(runs: Vec<Vec<Run>>) -> Self {
        let numbered = runs.iter().enumerate();
        let round_of = numbered.flat_map(|(round, runs)| runs.iter().map(move |&run| (run, round)));
        Self { round_of: round_of.collect(), runs }
    }

    /// Returns the numbers of the rounds after which settings are dropped.
    pub(super) fn numbers(&self) -> Range<usize> {
        0..self.runs.len()
    }

    pub(super) fn round_of(&self, run: Run) -> Option<usize> {
        self.round_of.get(&run).copied()
    }

    pub(super) fn runs(&self, round: usize) -> &[Run] {
        &self.runs[round]
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn each_stream_is_in_one_round(members in 1_usize..8, runs in 1_usize..6, windows in 0_usize..40, values in 2_usize..40) {
            let rounds = RacedStreams { members: (0..members).collect(), runs, windows }.rounds(values);
            let mut all: Vec<Run> = rounds.numbers().flat_map(|round| rounds.runs(round).to_vec()).collect();
            prop_assert_eq!(all.len(), members * runs + windows);
            all.sort_unstable();
            all.dedup();
            prop_assert_eq!(all.len(), members * runs + windows);
            for round in rounds.numbers() {
                for &run in rounds.runs(round) {
                    prop_assert_eq!(rounds.round_of(run), Some(round));
                }
            }
        }
    }

    #[test]
    fn a_halving_doubles_what_is_known() {
        let streams = RacedStreams { members: (0..5).collect(), runs: 3, windows: 15 };
        let rounds = streams.rounds(11);
        let sizes: Vec<usize> = rounds.numbers().map(|round| rounds.runs(round).len()).collect();
        assert_eq!(sizes, [2, 2, 4, 8, 14]);
        let member = EnvironmentId::Member;
        let log = EnvironmentId::LogReplay;
        assert_eq!(rounds.runs(0), [(member(0), 0), (log, 0)]);
        assert_eq!(rounds.runs(1), [(member(1), 0), (log, 8)]);
        assert_eq!(rounds.runs(2), [(member(2), 0), (log, 4), (member(3), 0), (log, 12)]);
    }

    #[test]
    fn without_members_the_windows_are_halved_alone() {
        let rounds = RacedStreams { members: Vec::new(), runs: 0, windows: 8 }.rounds(4);
        let sizes: Vec<usize> = rounds.numbers().map(|round| rounds.runs(round).len()).collect();
        assert_eq!(sizes, [2, 2, 4]);
        let log = EnvironmentId::LogReplay;
        assert_eq!(rounds.runs(0), [(log, 0), (log, 4)]);
        let none = RacedStreams { members: Vec::new(), runs: 0, windows: 0 };
        assert_eq!(none.rounds(4).numbers().count(), 0);
    }

    #[test]
    fn the_first_round_has_members_and_log() {
        for (members, runs, windows) in [(1, 1, 10), (1, 2, 30), (5, 10, 2), (5, 1, 1)] {
            let streams = RacedStreams { members: (0..members).collect(), runs, windows };
            let first = streams.rounds(11).runs(0).to_vec();
            assert!(first.contains(&(EnvironmentId::Member(0), 0)), "{first:?}");
            assert!(first.contains(&(EnvironmentId::LogReplay, 0)), "{first:?}");
        }
    }

    #[test]
    fn what_is_far_apart_fills_gaps() {
        assert_eq!(far_apart(6).collect::<Vec<_>>(), [0, 4, 2, 1, 5, 3]);
        assert_eq!(far_apart(1).collect::<Vec<_>>(), [0]);
        assert_eq!(far_apart(0).count(), 0);
    }
}
