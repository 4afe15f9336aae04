//! The sample period, and the stretches of the log in which it holds.

use std::ops::Range;

use calib_core::{Period, Timestamp};

use crate::log::rows::EXAMPLES;

/// Steps of the log that are not one period.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Steps {
    /// Stretches without a gap that cover all rows, in order.
    pub(crate) stretches: Vec<Range<usize>>,
    pub(crate) gaps: u64,
    pub(crate) longest_gap: i64,
    pub(crate) total_gap: i64,
    /// Of the longest gaps, the longest first: last row before it, first row after it.
    pub(crate) longest_gaps: Vec<(Timestamp, Timestamp)>,
    /// Steps shorter than the period divided by the tolerance.
    pub(crate) short: u64,
}

/// The median step, `None` for fewer than two rows.
pub(crate) fn detect_period(timestamps: &[Timestamp]) -> Option<Period> {
    let mut steps: Vec<i64> =
        timestamps.windows(2).map(|pair| pair[1].micros_since(pair[0])).collect();
    let middle = steps.len() / 2;
    if steps.is_empty() {
        return None;
    }
    Period::from_micros(*steps.select_nth_unstable(middle).1)
}

/// Cut the rows where a step is longer than `tolerance` periods, and before each of `breaks` (in order).
pub(crate) fn find_steps(
    timestamps: &[Timestamp],
    breaks: &[u32],
    period: Period,
    tolerance: f64,
) -> Steps {
    let longest = (period.as_micros() as f64 * tolerance).floor() as i64;
    let shortest = (period.as_micros() as f64 / tolerance).ceil() as i64;
    let mut found = Steps::default();
    let mut start = 0;
    for (row, pair) in timestamps.windows(2).enumerate() {
        let step = pair[1].micros_since(pair[0]);
        if step > longest {
            found.gaps += 1;
            found.longest_gap = found.longest_gap.max(step);
            found.total_gap += step;
            note_gap(&mut found.longest_gaps, (pair[0], pair[1]));
            found.stretches.push(start..row + 1);
            start = row + 1;
            continue;
        }
        if breaks.binary_search(&(row as u32 + 1)).is_ok() {
            found.stretches.push(start..row + 1);
            start = row + 1;
        }
        if step < shortest {
            found.short += 1;
        }
    }
    if start < timestamps.len() {
        found.stretches.push(start..timestamps.len());
    }
    found
}

/// Keep a gap if it is one of the longest; of equals the earlier one.
fn note_gap(longest: &mut Vec<(Timestamp, Timestamp)>, gap: (Timestamp, Timestamp)) {
    let place = longest.partition_point(|&known| length(known) >= length(gap));
    if place < EXAMPLES {
        longest.insert(place, gap);
        longest.truncate(EXAMPLES);
    }
}

fn length((from, to): (Timestamp, Timestamp)) -> i64 {
    to.micros_since(from)
}

/// The parts of the stretches that lie inside `part`.
pub(crate) fn inside(stretches: &[Range<usize>], part: &Range<usize>) -> Vec<Range<usize>> {
    stretches
        .iter()
        .map(|stretch| stretch.start.max(part.start)..stretch.end.min(part.end))
        .filter(|stretch| !stretch.is_empty())
        .collect()
}

/// The parts that lie inside the training range or the held-out one, in order.
pub(crate) fn inside_both(
    stretches: &[Range<usize>],
    train: &Range<usize>,
    held_out: Option<&Range<usize>>,
) -> Vec<Range<usize>> {
    let mut parts: Vec<&Range<usize>> = [train].into_iter().chain(held_out).collect();
    parts.sort_by_key(|part| part.start);
    parts.into_iter().flat_map(|part| inside(stretches, part)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seconds(seconds: &[f64]) -> Vec<Timestamp> {
        seconds.iter().map(|secs| Timestamp::from_micros((secs * 1e6) as i64)).collect()
    }

    fn period(times: &[f64]) -> Option<f64> {
        detect_period(&seconds(times)).map(Period::as_secs)
    }

    #[test]
    fn the_period_is_the_median_step() {
        assert_eq!(period(&[0.0, 1.0, 2.0, 3.0, 60.0]), Some(1.0));
        assert_eq!(period(&[0.0, 0.9, 2.0, 3.0, 4.0]), Some(1.0));
        assert_eq!(period(&[0.0, 60.0]), Some(60.0));
        assert_eq!(period(&[0.0]), None);
    }

    #[test]
    fn gaps_split_and_short_do_not() {
        let times = seconds(&[0.0, 1.0, 2.5, 3.0, 4.51, 5.51, 20.0]);
        let period = Period::from_secs(1.0).expect("positive");
        let steps = find_steps(&times, &[], period, 1.5);
        assert_eq!(steps.stretches, [0..4, 4..6, 6..7], "1.5 periods are tolerated");
        assert_eq!((steps.gaps, steps.short), (2, 1));
        assert_eq!(steps.longest_gap, 14_490_000);
        assert_eq!(steps.total_gap, 16_000_000);
        assert_eq!(steps.longest_gaps, [(times[5], times[6]), (times[3], times[4])]);
        assert_eq!(inside(&steps.stretches, &(2..5)), [2..4, 4..5]);
        assert_eq!(find_steps(&[], &[], period, 1.5), Steps::default());
        let broken = find_steps(&times, &[1, 4], period, 1.5);
        assert_eq!(broken.stretches, [0..1, 1..4, 4..6, 6..7]);
        assert_eq!((broken.gaps, broken.short), (2, 1), "a break is no gap");
    }
}
