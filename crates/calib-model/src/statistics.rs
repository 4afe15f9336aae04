use calib_core::RowIndex;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Maximum distance, in rows, from the continuation of the record at which a jump is not yet a departure (our choice).
const VICINITY: u32 = 10;

/// A run with fewer departures counts as a near-verbatim replay of the log (our choice): an agent sees few different
/// situations in it.
///
/// The rate per step is not informative by itself. Nearest neighbours in a smooth representation depart once in some
/// hours, whatever the sampling interval of the states (docs/jump-rates.md).
const FEWEST_DEPARTURES: f64 = 3.0;

/// Rollouts that visit less than this share of their reachable rows are circling (our choice).
const CIRCLING: f64 = 0.1;

/// How often rollouts jump.
///
/// A step *jumps* if it does not go to the next row of the log. That is, the drawn transition is not the one that
/// starts where the last one ended (`j ≠ i + 1`). A *run* is a maximal sequence of rows without a jump.
///
/// In a densely sampled log, the neighbours of a row are the row itself and the rows beside it. So a rollout may jump
/// in half of its steps and still stay close to the log. Therefore a jump also counts as a *departure* if it goes to a
/// row more than 10 rows from the row that would have continued the log (our choice).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct JumpStatistics {
    /// Number of steps in all rollouts.
    pub steps: usize,
    /// Number of steps that jump.
    pub jumps: usize,
    /// `jumps / steps`; 0 without steps.
    pub jump_rate: f64,
    /// Number of jumps that are departures.
    pub departures: usize,
    /// `departures / steps`; 0 without steps.
    pub departure_rate: f64,
    /// Mean number of rows in a run; 0 without rows.
    pub mean_run_length: f64,
    /// Largest number of rows in a run.
    pub longest_run: usize,
    /// Number of distinct rows visited.
    pub distinct_rows: usize,
}

impl JumpStatistics {
    /// Returns the joint statistics of trajectories, each given as the rows of one rollout.
    pub fn of<'a>(trajectories: impl IntoIterator<Item = &'a [RowIndex]>) -> Self {
        let mut rows = Vec::new();
        let mut steps = 0;
        let mut departures = 0;
        let mut runs = 0;
        let mut longest_run = 0;
        for trajectory in trajectories {
            rows.extend_from_slice(trajectory);
            steps += trajectory.len().saturating_sub(1);
            departures += trajectory
                .windows(2)
                .filter(|pair| pair[1].0.abs_diff(pair[0].0 + 1) > VICINITY)
                .count();
            for run in trajectory.chunk_by(|now, then| then.0 == now.0 + 1) {
                runs += 1;
                longest_run = longest_run.max(run.len());
            }
        }
        let visited = rows.len();
        rows.sort_unstable();
        rows.dedup();
        // Each trajectory has one run more than it has jumps, and one row more than steps.
        let jumps = runs - (visited - steps);
        Self {
            steps,
            jumps,
            jump_rate: ratio(jumps, steps),
            departures,
            departure_rate: ratio(departures, steps),
            mean_run_length: ratio(visited, runs),
            longest_run,
            distinct_rows: rows.len(),
        }
    }

    /// Whether runs of `run` steps mostly replay the log: fewer than three departures are expected per run. This
    /// deserves a warning, with the advice to make runs longer, or to increase the sampling interval.
    pub fn near_verbatim(&self, run: usize) -> bool {
        self.steps > 0 && self.departure_rate * (run as f64) < FEWEST_DEPARTURES
    }

    /// Whether the rollouts circle within few rows: they visit less than a tenth of the rows that they could, given the
    /// member's number of transitions (our choice). It happens where a row's neighbours are adjacent to it in time, so
    /// that with `exclude_self` or a `theiler` window a step leads back as often as forward.
    pub fn circling(&self, transitions: usize) -> bool {
        self.steps > 0
            && (self.distinct_rows as f64) < CIRCLING * self.steps.min(transitions) as f64
    }
}

/// Returns `a / b`, or 0 if `b` is 0.
fn ratio(a: usize, b: usize) -> f64 {
    if b == 0 { 0.0 } else { a as f64 / b as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(rows: &[u32]) -> Vec<RowIndex> {
        rows.iter().copied().map(RowIndex).collect()
    }

    #[test]
    fn runs_and_jumps_are_counted() {
        let a = rows(&[4, 5, 6, 2, 3, 3, 90]);
        let b = rows(&[6, 7]);
        let statistics = JumpStatistics::of([&a[..], &b[..]]);
        assert_eq!((statistics.steps, statistics.jumps), (7, 3));
        assert_eq!(statistics.jump_rate, 3.0 / 7.0);
        assert_eq!(statistics.mean_run_length, 9.0 / 5.0);
        assert_eq!((statistics.longest_run, statistics.distinct_rows), (3, 7));
        assert_eq!((statistics.departures, statistics.departure_rate), (1, 1.0 / 7.0));
        assert!(!statistics.near_verbatim(500));
    }

    #[test]
    fn a_replay_is_near_verbatim() {
        let replay: Vec<RowIndex> = (0..500).map(RowIndex).collect();
        let statistics = JumpStatistics::of([&replay[..]]);
        assert_eq!((statistics.jumps, statistics.longest_run), (0, 500));
        assert!(statistics.near_verbatim(1_000_000));
        // Moving back and forth along the record is no better, though every second step jumps.
        let shuffle: Vec<RowIndex> = (0..500).map(|t| RowIndex(t + t % 4 / 2 * 3)).collect();
        let statistics = JumpStatistics::of([&shuffle[..]]);
        assert!(statistics.jump_rate > 0.4 && statistics.near_verbatim(500));
        let away: Vec<RowIndex> = (0..500).map(|t| RowIndex(t % 50 * 11)).collect();
        assert!(!JumpStatistics::of([&away[..]]).near_verbatim(500));
        // One departure in 250 steps: a short run sees two situations of the log, and a long one many.
        let seldom: Vec<RowIndex> = (0..500).map(|t| RowIndex(t + t / 250 * 10_000)).collect();
        let seldom = JumpStatistics::of([&seldom[..]]);
        assert!(seldom.near_verbatim(500) && !seldom.near_verbatim(5_000));
    }

    #[test]
    fn a_loop_is_circling_and_a_replay_is_not() {
        let looped: Vec<RowIndex> = (0..500).map(|t| RowIndex(t % 15)).collect();
        let statistics = JumpStatistics::of([&looped[..]]);
        assert!(statistics.circling(10_000));
        assert!(!statistics.circling(20), "there are no more rows to visit");
        let replay: Vec<RowIndex> = (0..500).map(RowIndex).collect();
        assert!(!JumpStatistics::of([&replay[..]]).circling(10_000));
    }

    #[test]
    fn nothing_has_no_statistics() {
        let statistics = JumpStatistics::of([]);
        assert_eq!(
            (statistics.steps, statistics.jump_rate, statistics.mean_run_length),
            (0, 0.0, 0.0)
        );
        assert!(!statistics.near_verbatim(500));
        let single = JumpStatistics::of([&rows(&[3])[..]]);
        assert_eq!((single.jumps, single.mean_run_length), (0, 1.0));
    }
}
