use std::ops::Range;

use calib_core::{Rng, Seed};

use crate::options::SECONDS_PER_DAY;

/// Rows of one day: instant `first + row`, `period_secs` apart, counted from the plant's start.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DayGrid {
    pub(crate) day: u32,
    pub(crate) first: i64,
    pub(crate) rows: usize,
    pub(crate) period_secs: f64,
}

impl DayGrid {
    /// Returns the seconds from the plant's start to row `row`.
    pub(crate) fn secs(&self, row: usize) -> f64 {
        (self.first + row as i64) as f64 * self.period_secs
    }

    /// Returns the elapsed share of the day at row `row`, 0 – 1.
    pub(crate) fn share(&self, row: usize) -> f64 {
        self.secs(row) / SECONDS_PER_DAY - f64::from(self.day)
    }

    /// Returns the rows at or after `from` and before `to` seconds.
    fn rows_between(&self, from: f64, to: f64) -> Range<usize> {
        let [first, end] = [from, to].map(|secs| {
            let instant = (secs / self.period_secs).ceil() - self.first as f64;
            instant.clamp(0.0, self.rows as f64) as usize
        });
        first..end
    }
}

/// Faults that begin at random instants and have log-normal durations. Those of a day follow only
/// from the seed and the number of the day, so that a day can be generated without the days before
/// it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Faults {
    pub(crate) seed: Seed,
    /// Mean rate per day.
    pub(crate) per_day: f64,
    /// Median duration. No fault lasts more than `longest_secs`, which is at most a day.
    pub(crate) median_secs: f64,
    /// Standard deviation of the logarithm of the duration.
    pub(crate) spread: f64,
    pub(crate) longest_secs: f64,
}

impl Faults {
    /// Returns the rows of the faults that begin on the day, cut at midnight.
    pub(crate) fn within(&self, grid: &DayGrid) -> Vec<Range<usize>> {
        self.rows_of(grid, grid.day).collect()
    }

    /// Returns the rows in a fault, including faults that continue from the day before. Ranges are
    /// in order, do not overlap, and cover at most `share` of the day's rows; the excess is
    /// dropped.
    pub(crate) fn touching(&self, grid: &DayGrid, share: f64) -> Vec<Range<usize>> {
        let before = grid.day.checked_sub(1);
        let mut spans: Vec<Range<usize>> =
            before.into_iter().chain([grid.day]).flat_map(|day| self.rows_of(grid, day)).collect();
        spans.sort_unstable_by_key(|span| (span.start, span.end));
        let mut left = (share * grid.rows as f64) as usize;
        let mut next = 0;
        let mut kept = Vec::new();
        for span in spans {
            let start = span.start.max(next);
            let end = span.end.min(start + left);
            if start < end {
                left -= end - start;
                next = end;
                kept.push(start..end);
            }
        }
        kept
    }

    fn rows_of(&self, grid: &DayGrid, day: u32) -> impl Iterator<Item = Range<usize>> {
        let mut rng = self.seed.number(u64::from(day)).rng();
        let mut spans = Vec::new();
        for at in arrivals(self.per_day, &mut rng) {
            let from = (f64::from(day) + at) * SECONDS_PER_DAY;
            let lasting = self.median_secs * (self.spread * rng.normal()).exp();
            spans.push(grid.rows_between(from, from + lasting.min(self.longest_secs)));
        }
        spans.into_iter().filter(|span| !span.is_empty())
    }
}

/// Returns the instants of a Poisson process of rate `per_day` in a day, as shares of the day, in
/// order.
pub(crate) fn arrivals(per_day: f64, rng: &mut Rng) -> Vec<f64> {
    let mut instants = Vec::new();
    if per_day > 0.0 {
        let mut at = rng.exponential() / per_day;
        while at < 1.0 {
            instants.push(at);
            at += rng.exponential() / per_day;
        }
    }
    instants
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn faults(seed: u64, per_day: f64, median_secs: f64) -> Faults {
        Faults { seed: Seed::new(seed), per_day, median_secs, spread: 1.0, longest_secs: 3600.0 }
    }

    fn grid(day: u32, period_secs: f64) -> DayGrid {
        let rows = (86_400.0 / period_secs) as usize;
        DayGrid { day, first: i64::from(day) * rows as i64, rows, period_secs }
    }

    #[test]
    fn the_share_of_faulty_rows_does_not_depend_on_the_period() {
        // Mean of a log-normal: median · exp(σ²/2).
        let expected = 20.0 * 10.0 * 0.5_f64.exp() / 86_400.0;
        for period_secs in [1.0, 60.0] {
            let mut faulty = 0;
            let mut all = 0;
            for day in 0..2000 {
                let grid = grid(day, period_secs);
                let spans = faults(1, 20.0, 10.0).touching(&grid, 1.0);
                faulty += spans.iter().map(ExactSizeIterator::len).sum::<usize>();
                all += grid.rows;
            }
            let got = faulty as f64 / all as f64;
            assert!((got / expected - 1.0).abs() < 0.08, "{period_secs}: {got} {expected}");
        }
    }

    #[test]
    fn a_fault_goes_on_after_midnight() {
        let faults = faults(3, 12.0, 3000.0);
        let carried = (0..50).any(|day| {
            let ends = faults.touching(&grid(day, 60.0), 1.0);
            let begins = faults.touching(&grid(day + 1, 60.0), 1.0);
            ends.last().is_some_and(|span| span.end == 1440)
                && begins.first().is_some_and(|span| span.start == 0)
        });
        assert!(carried);
        for day in 0..50 {
            assert!(faults.within(&grid(day, 60.0)).iter().all(|span| span.end <= 1440));
        }
    }

    proptest! {
        #[test]
        fn spans_are_ordered_and_capped(seed: u64, per_day in 0.0_f64..50.0, share in 0.0_f64..0.3) {
            let grid = grid(2, 10.0);
            let spans = faults(seed, per_day, 600.0).touching(&grid, share);
            for pair in spans.windows(2) {
                prop_assert!(pair[0].end <= pair[1].start);
            }
            let total: usize = spans.iter().map(ExactSizeIterator::len).sum();
            prop_assert!(total as f64 <= share * grid.rows as f64);
            prop_assert!(spans.iter().all(|span| !span.is_empty() && span.end <= grid.rows));
        }
    }
}
