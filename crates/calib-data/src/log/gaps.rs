//! Finds the sample period, and the stretches of the log without a gap.

use std::ops::Range;

use calib_core::{Period, Timestamp};

use crate::log::rows::EXAMPLES;

/// Maximum relative difference of steps that count as equal: clocks drift, and loggers round to whole seconds. Our
/// choice.
const ALIKE: f64 = 0.1;
/// Minimum share of equal steps in a log with one interval. With [`ALIKE`], it accepts rows 1.1 s apart whose times are
/// cut to whole seconds: a tenth of their steps is 2 s. Our choice.
const REGULAR: f64 = 0.9;

/// Steps of the log that differ from the period.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Steps {
    /// Stretches without a gap that cover all rows, in order.
    pub(crate) stretches: Vec<Range<usize>>,
    pub(crate) gaps: u64,
    pub(crate) longest_gap: i64,
    pub(crate) total_gap: i64,
    /// The longest gaps, the longest first: last row before the gap, first row after it.
    pub(crate) longest_gaps: Vec<(Timestamp, Timestamp)>,
    /// Number of steps shorter than the period divided by the tolerance.
    pub(crate) short: u64,
}

/// Returns the median step, `None` for fewer than two rows.
pub(crate) fn detect_period(timestamps: &[Timestamp]) -> Option<Period> {
    let mut steps: Vec<i64> =
        timestamps.windows(2).map(|pair| pair[1].micros_since(pair[0])).collect();
    let middle = steps.len() / 2;
    if steps.is_empty() {
        return None;
    }
    Period::from_micros(*steps.select_nth_unstable(middle).1)
}

/// Returns the recording interval: the median step, if most other steps are about equal. Returns `None` for uneven
/// steps, for which any period may be intended.
pub(crate) fn interval(timestamps: &[Timestamp]) -> Option<Period> {
    let median = detect_period(timestamps)?;
    let mut alike = 0_usize;
    for pair in timestamps.windows(2) {
        let step = Period::from_micros(pair[1].micros_since(pair[0]));
        alike += usize::from(step.is_some_and(|step| are_alike(step, median)));
    }
    (alike as f64 >= REGULAR * (timestamps.len() - 1) as f64).then_some(median)
}

/// Whether a step is about as long as the median one.
pub(crate) fn are_alike(step: Period, median: Period) -> bool {
    step.as_micros().abs_diff(median.as_micros()) as f64 <= ALIKE * median.as_micros() as f64
}

/// Cuts the rows where a step is longer than `tolerance` periods, and before each of `breaks` (in order).
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

/// Keeps a gap if it is one of the longest; on a tie, the earlier gap.
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

/// Returns the parts of the stretches that lie inside `part`.
pub(crate) fn inside(stretches: &[Range<usize>], part: &Range<usize>) -> Vec<Range<usize>> {
    stretches
        .iter()
        .map(|stretch| stretch.start.max(part.start)..stretch.end.min(part.end))
        .filter(|stretch| !stretch.is_empty())
        .collect()
}

/// Returns the parts that lie inside the training range or the held-out range, in order.
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

    fn recorded(times: &[f64]) -> Option<f64> {
        interval(&seconds(times)).map(Period::as_secs)
    }

    /// Returns times at steps of `secs`, cut to whole seconds.
    fn cut(secs: f64) -> Vec<f64> {
        (0..200).map(|row| (secs * f64::from(row)).floor()).collect()
    }

    #[test]
    fn an_interval_is_what_nearly_all_steps_are() {
        let even: Vec<f64> = (0..20).map(f64::from).collect();
        assert_eq!(recorded(&even), Some(1.0));
        let drifting: Vec<f64> = even.iter().map(|row| 1.03 * row).collect();
        assert!(recorded(&drifting).is_some());
        let broken: Vec<f64> =
            even.iter().map(|row| if *row < 9.0 { *row } else { 500.0 + row }).collect();
        assert_eq!(recorded(&broken), Some(1.0), "one gap");
        assert_eq!(recorded(&[0.0, 1.0, 4.0, 5.0, 9.0, 10.0]), None, "as values change");
        assert_eq!(recorded(&[0.0]), None);
        assert_eq!(recorded(&cut(1.05)), Some(1.0));
        assert_eq!(recorded(&cut(1.4)), None, "whole seconds do not tell");
        let [one, other] = [1.0, 1.1].map(|secs| Period::from_secs(secs).expect("positive"));
        assert!(are_alike(other, one));
        assert!(!are_alike(Period::from_secs(0.7).expect("positive"), one));
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
