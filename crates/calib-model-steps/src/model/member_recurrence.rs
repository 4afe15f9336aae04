//! Whether rollouts of a member return to rows that they have visited: statistics, in the manifest of its model.

use std::ops::Range;

use calib_core::{Frames, Seed, Timestamp, TransitionIndex};
use calib_knn::{Ends, KnnModel, Recurrence, Weights};
use calib_model::RolloutStatistics;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Maximum number of time spans that are listed.
const TOLD: usize = 10;
/// Time spans that are at most this many transitions apart are merged.
const APART: u32 = 10;

/// Traps and rollout statistics of an ensemble member, in the manifest of its model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct MemberRecurrence {
    #[serde(flatten)]
    pub(crate) classes: Recurrence,
    /// Times of the transitions that are left out: the ten longest stretches, in order of time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) left_out_times: Vec<Stretch>,
    /// Times at which traps were given exits, at most ten.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) exit_times: Vec<Timestamp>,
    #[serde(flatten)]
    pub(crate) rollouts: RolloutStatistics,
}

/// A stretch of the log.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct Stretch {
    /// Times of the states at which its first and its last transition start.
    pub(crate) times: [Timestamp; 2],
    /// Number of its candidates that are left out.
    pub(crate) candidates: usize,
}

impl MemberRecurrence {
    /// Computes the recurrence of `member`, whose rollouts end in `ends`.
    pub(crate) fn new(
        knn: &KnnModel,
        member: usize,
        classes: Recurrence,
        ends: &Ends,
        frames: &Frames,
        weights: Weights,
        seed: u64,
    ) -> Self {
        // Rollouts were called walks. The seed keeps the name, so that the numbers of models stay.
        let seed = Seed::new(seed).child("walks").number(member as u64);
        let left_out = knn.left_out(member);
        let mut rollouts = RolloutStatistics::of(&knn.member(member), ends, weights, seed);
        if classes.after.count > 1 {
            // Separate parts do not mix, wherever they are.
            rollouts.mixing_steps = None;
        }
        Self {
            classes,
            left_out_times: longest(left_out.runs())
                .into_iter()
                .map(|(run, candidates): (Range<u32>, usize)| Stretch {
                    times: [run.start, run.end - 1].map(|transition| time(knn, frames, transition)),
                    candidates,
                })
                .collect(),
            exit_times: left_out
                .exits()
                .take(TOLD)
                .map(|(row, _)| time(knn, frames, row))
                .collect(),
            rollouts,
        }
    }

    /// Returns the effective share of the member's rows over which rollouts are spread.
    pub(super) fn covered(&self, transitions: usize) -> Option<f64> {
        self.rollouts.effective_rows.map(|rows| (rows / transitions as f64).min(1.0))
    }
}

/// Returns the time of the state at which a transition starts.
fn time(knn: &KnnModel, frames: &Frames, transition: u32) -> Timestamp {
    let row = knn.transitions().source(TransitionIndex(transition));
    frames.timestamps()[row.get()]
}

/// Returns the longest of these runs, with the number of candidates in each, in order. Adjacent runs are merged first.
fn longest(runs: impl Iterator<Item = Range<u32>>) -> Vec<(Range<u32>, usize)> {
    let mut joined: Vec<(Range<u32>, usize)> = Vec::new();
    for run in runs {
        match joined.last_mut() {
            Some((last, count)) if run.start - last.end <= APART => {
                *count += run.len();
                last.end = run.end;
            }
            _ => joined.push((run.clone(), run.len())),
        }
    }
    joined.sort_by_key(|(run, count)| (std::cmp::Reverse(*count), run.start));
    joined.truncate(TOLD);
    joined.sort_by_key(|(run, _)| run.start);
    joined
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_stretches_are_one_and_the_longest_are_told() {
        let runs = [0..3, 5..6, 40..50, 61..62];
        let all = longest(runs.into_iter());
        assert_eq!(all, [(0..6, 4), (40..50, 10), (61..62, 1)]);
        let many = (0..30_u32).map(|number| 100 * number..100 * number + number + 1);
        let told = longest(many);
        assert_eq!((told.len(), told[0].1, told[9].1), (10, 21, 30));
    }
}
