//! Puts channels that were recorded at different times on one clock.
//!
//! Rows lie at multiples of the period since 1970, so they do not depend on the start of the log. There is a row
//! wherever any channel was recorded at most `max_age` before it. No value crosses from one range to another. A channel
//! may have its own age, for which its values stay valid in these rows. It adds no rows, because all other channels
//! would be missing there.

use std::ops::Range;

use calib_core::{Period, Timestamp};

use super::{split::rows_in, union::Union};
use crate::{BridgedStops, Resample};

/// The rows of a resampled log.
#[derive(Clone, Debug)]
pub(crate) struct Grid {
    resample: Resample,
    period: i64,
    max_age: i64,
    /// Instants of the ranges, half-open. Samples count only for rows of their own range.
    ranges: Vec<Range<i64>>,
}

/// A channel has stopped if it has no value for more than this many of its usual steps, and of the periods of the rows.
const STOP: i64 = 10;

/// Chosen rows as runs: the first row and the row after the last, in periods since 1970.
pub(crate) struct Coverage(Union<(i64, i64)>);

impl Coverage {
    pub(crate) fn new() -> Self {
        Self(Union::new(join))
    }

    pub(crate) fn rows(&mut self) -> u64 {
        self.runs().iter().map(|(from, to)| from.abs_diff(*to)).sum()
    }

    fn runs(&mut self) -> &[(i64, i64)] {
        self.0.settled()
    }
}

/// Joins runs of rows that touch.
fn join(next: &mut (i64, i64), last: &mut (i64, i64)) -> bool {
    let touch = next.0 <= last.1;
    if touch {
        last.1 = last.1.max(next.1);
    }
    touch
}

impl Grid {
    pub(crate) fn new(
        resample: Resample,
        period: Period,
        max_age: i64,
        ranges: Vec<Range<i64>>,
    ) -> Self {
        Self { resample, period: period.as_micros(), max_age, ranges }
    }

    /// Returns the same rows with another `max_age`, in microseconds.
    pub(crate) fn with_max_age(&self, max_age: i64) -> Self {
        Self { max_age, ..self.clone() }
    }

    pub(crate) fn of_last_values(&self) -> Self {
        Self { resample: Resample::Last, ..self.clone() }
    }

    /// Chooses the rows for which a sample at one of `times` (in order) is recent enough. Memory holds one run of rows
    /// for each stretch of samples, however many rows it has.
    pub(crate) fn cover(&self, times: &[i64], coverage: &mut Coverage) {
        for range in &self.ranges {
            let end = self.row_from(range.end);
            let runs = times[samples_in(times, range)].iter().map(|&time| {
                let to =
                    time.saturating_add(self.max_age).div_euclid(self.period).saturating_add(1);
                (self.row_from(time), to.min(end))
            });
            coverage.0.extend(runs.filter(|(from, to)| from < to));
        }
    }

    pub(crate) fn rows(&self, coverage: &mut Coverage) -> Vec<Timestamp> {
        let runs = coverage.runs().iter();
        let rows = runs.flat_map(|&(from, to)| from..to);
        rows.map(|row| Timestamp::from_micros(row * self.period)).collect()
    }

    /// Returns the first row at or after `time`.
    fn row_from(&self, time: i64) -> i64 {
        time.div_euclid(self.period) + i64::from(time.rem_euclid(self.period) > 0)
    }

    /// Returns the values of a channel in `rows`, NaN where there is no value. All samples have values and are in
    /// order.
    pub(crate) fn values(&self, times: &[i64], values: &[f64], rows: &[Timestamp]) -> Vec<f64> {
        let mut out = vec![f64::NAN; rows.len()];
        for range in &self.ranges {
            let samples = samples_in(times, range);
            let times = &times[samples.clone()];
            let values = &values[samples];
            let inside = rows_in(rows, range);
            for (row, out) in rows[inside.clone()].iter().zip(&mut out[inside]) {
                let row = row.as_micros();
                // Samples up to and including the row.
                let before = times.partition_point(|&time| time <= row);
                *out = self.value(times, values, row, before);
            }
        }
        out
    }

    /// Returns the stops of a channel, recorded at `times`, that are bridged: each is longer than [`STOP`] of its usual
    /// steps, and no longer than `max_age`.
    pub(crate) fn bridged(&self, times: &[i64]) -> BridgedStops {
        let mut bridged = BridgedStops::default();
        for range in &self.ranges {
            let times = &times[samples_in(times, range)];
            let steps = times.windows(2).map(|pair| pair[1] - pair[0]);
            let mut sorted: Vec<i64> = steps.clone().collect();
            let middle = sorted.len() / 2;
            if sorted.is_empty() {
                continue;
            }
            let usual = *sorted.select_nth_unstable(middle).1;
            let least = usual.max(self.period).saturating_mul(STOP);
            for stop in steps.filter(|step| *step > least && *step <= self.max_age) {
                bridged.count += 1;
                bridged.longest_secs = bridged.longest_secs.max(stop as f64 / 1e6);
                bridged.usual_secs = bridged.usual_secs.max(usual as f64 / 1e6);
            }
        }
        bridged
    }

    fn value(&self, times: &[i64], values: &[f64], row: i64, before: usize) -> f64 {
        let Some(last) = before.checked_sub(1) else { return f64::NAN };
        match self.resample {
            Resample::Last if row - times[last] <= self.max_age => values[last],
            Resample::Last => f64::NAN,
            Resample::Mean => self.mean(times, values, row, last),
            Resample::Linear => {
                let Some(&after) = times.get(before) else {
                    return if times[last] == row { values[last] } else { f64::NAN };
                };
                let span = after - times[last];
                if times[last] == row {
                    values[last]
                } else if span <= self.max_age {
                    let share = (row - times[last]) as f64 / span as f64;
                    values[last] * (1.0 - share) + values[before] * share
                } else {
                    f64::NAN
                }
            }
        }
    }

    /// Returns Σ vᵢ dᵢ / Σ dᵢ over the values that were valid in the period that ends at `row`. dᵢ is how long a value
    /// was valid, at most `max_age` after it was recorded. A value at the row itself counts only if no value was valid
    /// before it.
    fn mean(&self, times: &[i64], values: &[f64], row: i64, last: usize) -> f64 {
        let begin = row - self.period;
        let mut sum = 0.0;
        let mut weight = 0.0;
        let mut end = row;
        for sample in (0..=last).rev() {
            let from = times[sample].max(begin);
            let to = end.min(times[sample].saturating_add(self.max_age));
            if to > from {
                let stood = (to - from) as f64;
                sum += values[sample] * stood;
                weight += stood;
            }
            end = times[sample];
            if times[sample] <= begin {
                break;
            }
        }
        if weight > 0.0 {
            sum / weight
        } else if times[last] == row {
            values[last]
        } else {
            f64::NAN
        }
    }
}

/// Returns the positions of the times in a range.
fn samples_in(times: &[i64], range: &Range<i64>) -> Range<usize> {
    let from = times.partition_point(|&time| time < range.start);
    let to = times.partition_point(|&time| time < range.end);
    from..to.max(from)
}

#[cfg(test)]
mod tests {
    use std::slice::from_ref;

    use proptest::prelude::*;

    use super::*;

    fn grid(resample: Resample, period: i64, max_age: i64, ranges: &[Range<i64>]) -> Grid {
        let period = Period::from_micros(period).expect("positive");
        Grid::new(resample, period, max_age, ranges.to_vec())
    }

    fn rows(grid: &Grid, times: &[i64]) -> Vec<Timestamp> {
        let mut coverage = Coverage::new();
        grid.cover(times, &mut coverage);
        let rows = grid.rows(&mut coverage);
        assert_eq!(rows.len() as u64, coverage.rows());
        rows
    }

    fn values(grid: &Grid, samples: &[(i64, f64)]) -> Vec<(i64, f64)> {
        let (times, of_samples): (Vec<i64>, Vec<f64>) = samples.iter().copied().unzip();
        let rows = rows(grid, &times);
        let values = grid.values(&times, &of_samples, &rows);
        rows.into_iter().map(Timestamp::as_micros).zip(values).collect()
    }

    #[test]
    fn values_stand_until_they_are_too_old() {
        let samples = [(3, 1.0), (12, 2.0), (50, 4.0)];
        let last = values(&grid(Resample::Last, 10, 20, from_ref(&(0..60))), &samples);
        assert_eq!(last, [(10, 1.0), (20, 2.0), (30, 2.0), (50, 4.0)]);
        let linear = values(&grid(Resample::Linear, 10, 38, from_ref(&(0..60))), &samples);
        let linear = linear.into_iter().map(|(time, value)| (time, (value * 1e6).round() / 1e6));
        let expected =
            [(10, 1.777_778), (20, 2.421_053), (30, 2.947_368), (40, 3.473_684), (50, 4.0)];
        assert_eq!(linear.collect::<Vec<_>>(), expected);
        let mean = values(&grid(Resample::Mean, 10, 20, from_ref(&(0..60))), &samples);
        // The value was 1 from 3 to 10 and still from 10 to 12, then 2 until 32; at 50 only the value itself counts.
        assert_eq!(mean, [(10, 1.0), (20, 1.8), (30, 2.0), (50, 4.0)]);
    }

    #[test]
    fn nothing_crosses_from_one_range_to_another() {
        let samples = [(5, 1.0), (25, 2.0)];
        for resample in [Resample::Last, Resample::Mean, Resample::Linear] {
            let whole = grid(resample, 10, 100, &[0..20, 20..40]);
            let first = grid(resample, 10, 100, from_ref(&(0..20)));
            let cut: Vec<(i64, f64)> =
                values(&whole, &samples).into_iter().filter(|(time, _)| *time < 20).collect();
            let alone = values(&first, &samples[..1]);
            assert_eq!(format!("{cut:?}"), format!("{alone:?}"), "{resample:?}");
        }
        let late = values(&grid(Resample::Last, 10, 100, &[0..20, 20..40]), &samples);
        assert_eq!(late, [(10, 1.0), (30, 2.0)], "20 is before the first sample of its range");
    }

    fn bridged(times: &[i64], max_age: i64) -> BridgedStops {
        grid(Resample::Last, 10, max_age, from_ref(&(0..4_000))).bridged(times)
    }

    #[test]
    fn stops_that_values_stand_over_are_counted() {
        let often: Vec<i64> = (0..100).chain(1_300..1_400).chain(3_000..3_100).collect();
        let one = BridgedStops { count: 1, longest_secs: 1_201e-6, usual_secs: 1e-6 };
        assert_eq!(bridged(&often, 1_250), one);
        assert_eq!(bridged(&often, 1_800).count, 2);
        assert_eq!(bridged(&often, 100), BridgedStops::default(), "missing there");
        let seldom: Vec<i64> = (0..40).map(|step| step * 100).collect();
        assert_eq!(bridged(&seldom, 3_000), BridgedStops::default(), "its usual step");
        assert_eq!(bridged(&[], 3_000), BridgedStops::default());
    }

    #[test]
    fn rows_are_counted_before_there_are_any() {
        let grid = grid(Resample::Last, 1, i64::MAX, from_ref(&(0..4_000_000_000_000_000)));
        let mut coverage = Coverage::new();
        grid.cover(&[0, 2_000_000_000_000_000], &mut coverage);
        assert_eq!(coverage.rows(), 4_000_000_000_000_000);
    }

    proptest! {
        #[test]
        fn the_last_value_is_its_definition(
            mut times in prop::collection::vec(-40_i64..40, 0..12),
            period in 1_i64..9,
            max_age in 1_i64..20,
            (start, length) in (-50_i64..20, 1_i64..60),
        ) {
            times.sort_unstable();
            times.dedup();
            let samples: Vec<(i64, f64)> = times.iter().map(|&time| (time, time as f64)).collect();
            let range = start..start + length;
            let got = values(&grid(Resample::Last, period, max_age, from_ref(&range)), &samples);
            let expected: Vec<(i64, f64)> = range.clone()
                .filter(|row| row.rem_euclid(period) == 0)
                .filter_map(|row| {
                    let last = times.iter().rev().find(|time| **time <= row && range.contains(time))?;
                    (row - last <= max_age).then_some((row, *last as f64))
                })
                .collect();
            prop_assert_eq!(&got, &expected);
            // The mean over a period is the mean over its microseconds.
            let mean = values(&grid(Resample::Mean, period, max_age, from_ref(&range)), &samples);
            for (row, value) in mean {
                let stood = (row - period..row).filter_map(|micro| {
                    let last = times.iter().rev().find(|time| **time <= micro && range.contains(time))?;
                    (micro - last < max_age).then_some(*last as f64)
                });
                let stood: Vec<f64> = stood.collect();
                if stood.is_empty() {
                    prop_assert!(value.is_nan() || times.contains(&row));
                } else {
                    let expected = stood.iter().sum::<f64>() / stood.len() as f64;
                    prop_assert!((value - expected).abs() < 1e-9, "{} {}", value, expected);
                }
            }
        }
    }
}
