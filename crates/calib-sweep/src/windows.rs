use calib_agent::Part;
use calib_core::Segments;
use calib_files::{Fingerprint, Fingerprinter};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Span;

/// The conditions under which a run can be scored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScoringDemand {
    /// Length of streams.
    pub span: Span,
    /// The largest discount factor.
    pub gamma: f64,
    /// The part of a run that is scored.
    pub part: Part,
}

/// Windows of recorded rows in which the streams of a replay start.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Windows {
    /// First row of each window, in the order in which runs use them.
    pub starts: Vec<usize>,
    /// Number of states of each stream.
    pub states: usize,
    /// Number of windows that were left out because gaps leave too few steps to score.
    pub left_out: usize,
}

impl Windows {
    /// Returns at most `most` windows of the held-out rows of `segments`, in time order. They do not overlap and are
    /// evenly spread over all rows. Their number is limited by how many fit side by side.
    ///
    /// Windows that do not overlap are as independent as held-out data can be. If not even one fits, all rows form the
    /// only window. Its last returns are then incomplete.
    pub fn held_out(segments: &Segments, demand: ScoringDemand, most: usize) -> Self {
        let rows = segments.rows();
        let states = demand.span.states().min(rows);
        let count = Self::side_by_side(rows, demand.span, most);
        let spread = (0..count).map(|window| spread(window, count, rows - states));
        Self::scorable(spread.collect(), states, segments, demand)
    }

    /// Returns how many windows fit side by side into `rows` rows, including the states after the steps of each. The
    /// number is at least one and at most `most`.
    pub fn side_by_side(rows: usize, span: Span, most: usize) -> usize {
        (rows / span.states().max(1)).min(most).max(1)
    }

    /// Returns `count` windows of the log of `segments`. The latest comes first, and the others are evenly spread over
    /// the rows before it. They overlap where necessary. A log that is shorter than a stream is replayed repeatedly,
    /// from as many different rows.
    pub fn log(segments: &Segments, demand: ScoringDemand, count: usize) -> Self {
        let rows = segments.rows();
        let states = demand.span.states();
        let starts = (0..count).map(|window| match rows.checked_sub(states) {
            Some(last) => last - spread(window, count, last),
            // The first window ends with the log.
            None => (rows - states % rows.max(1) + window * rows / count) % rows.max(1),
        });
        Self::scorable(starts.collect(), states, segments, demand)
    }

    /// Returns those of `starts` whose streams have at least a tenth of the scorable steps of an unbroken stream. If
    /// there are none, returns those with any step to score. Every window has the same weight, and one of a few steps
    /// is no evidence.
    fn scorable(
        starts: Vec<usize>,
        states: usize,
        segments: &Segments,
        demand: ScoringDemand,
    ) -> Self {
        let all = starts.len();
        let ScoringDemand { span, gamma, part } = demand;
        let steps = span.steps_in(states);
        let scored: Vec<(usize, usize)> = starts
            .into_iter()
            .map(|start| {
                let pieces = segments.looped_pieces(start, states);
                (start, part.scored_steps(&pieces, gamma, steps))
            })
            .collect();
        let unbroken = part.scored_steps(std::slice::from_ref(&(0..states)), gamma, steps);
        let mut starts = starts_with(&scored, unbroken.div_ceil(10));
        if starts.is_empty() {
            starts = starts_with(&scored, 1);
        }
        let left_out = all - starts.len();
        Self { starts, states, left_out }
    }

    /// Returns the fingerprint of the inputs of the stream of `run`. `data` is the fingerprint of the data.
    pub fn inputs(&self, data: &Fingerprint, run: usize) -> Fingerprint {
        let mut fingerprint = Fingerprinter::default();
        fingerprint.add(data.to_string().as_bytes());
        for number in [self.starts[self.of_run(run)], self.states] {
            fingerprint.add(&(number as u64).to_le_bytes());
        }
        fingerprint.finish()
    }

    /// Returns the window that `run` replays.
    pub fn of_run(&self, run: usize) -> usize {
        run % self.starts.len()
    }
}

/// Returns the starts of the windows, each with its scored steps, that have `least` of them or more, and at least one.
fn starts_with(scored: &[(usize, usize)], least: usize) -> Vec<usize> {
    let enough = scored.iter().filter(|window| window.1 >= least.max(1));
    enough.map(|window| window.0).collect()
}

/// Returns the place of item `number` of `count` evenly spread items. The first is at 0 and the last at `last`.
fn spread(number: usize, count: usize, last: usize) -> usize {
    (number as u128 * last as u128 / (count.max(2) - 1) as u128) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segments(lengths: &[usize]) -> Segments {
        Segments::from_lengths(lengths.iter().copied()).expect("valid")
    }

    /// Demands ten steps and two states after them.
    fn demand() -> ScoringDemand {
        ScoringDemand { span: Span { steps: 10, tail: 2 }, gamma: 0.1, part: Part::WholeRun }
    }

    #[test]
    fn held_out_windows_do_not_overlap() {
        for rows in 1..80 {
            for most in 1..6 {
                let Windows { starts, states, left_out } =
                    Windows::held_out(&segments(&[rows]), demand(), most);
                assert!(starts.windows(2).all(|pair| pair[0] + states <= pair[1]), "{starts:?}");
                assert!(starts.iter().all(|start| start + states <= rows));
                assert_eq!(starts.len() + left_out, (rows / 12).clamp(1, most), "{rows} {most}");
                assert_eq!(states, rows.min(12));
                let last = starts.last().map_or(rows - states, |&last| last);
                assert!(starts.len() < 2 || last + states == rows, "they reach to the end");
            }
        }
    }

    #[test]
    fn windows_that_gaps_leave_nothing_of_are_left_out() {
        // Segments of two rows: with γ = 0.1 no return of two states is known.
        let lengths: Vec<usize> = (0..6).map(|_| 2).chain([12]).collect();
        let windows = Windows::held_out(&segments(&lengths), demand(), 4);
        assert_eq!((windows.starts, windows.left_out), (vec![12], 1));
    }

    #[test]
    fn windows_of_a_few_steps_count_only_where_there_are_no_others() {
        // A step or two to score in the first window, ten in the second. γ = 0.5 needs seven states.
        let demand =
            ScoringDemand { span: Span { steps: 40, tail: 7 }, gamma: 0.5, part: Part::WholeRun };
        let pieces: Vec<usize> = (0..5).map(|_| 7).chain([9, 3, 47]).collect();
        let windows = Windows::held_out(&segments(&pieces), demand, 2);
        assert_eq!((windows.starts, windows.left_out), (vec![47], 1));
        let windows = Windows::held_out(&segments(&pieces[..7]), demand, 2);
        assert_eq!(windows.starts.len(), 1, "better than nothing: {windows:?}");
    }

    #[test]
    fn the_latest_window_of_the_log_comes_first() {
        let windows = Windows::log(&segments(&[40]), demand(), 3);
        assert_eq!(windows.starts, [28, 14, 0]);
        assert_eq!(Windows::log(&segments(&[40]), demand(), 1).starts, [28]);
        assert_eq!((windows.of_run(0), windows.of_run(4)), (0, 1));
    }

    #[test]
    fn a_short_log_is_replayed_over_and_over() {
        let windows = Windows::log(&segments(&[8]), demand(), 4);
        assert_eq!(windows.states, 12);
        assert_eq!(windows.starts[0], 4, "twelve states from row 4 end with the log");
        let mut different = windows.starts.clone();
        different.sort_unstable();
        different.dedup();
        assert_eq!(different.len(), 4);
    }
}
