//! Separates rows that share a time because an export cut times to whole minutes or hours.

use super::rows::NO_TIME;

/// Minimum number of distinct times: fewer do not show the step between them.
const FEWEST: usize = 3;
/// Minimum share of the times with about the usual number of rows: the first and the last time of a log are rarely
/// complete.
const ALIKE: f64 = 0.9;
/// Maximum relative difference of the number of rows at such a time.
const TOLERANCE: f64 = 0.1;

/// The repetition of times in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SharedTimes {
    /// Number of rows per time, as for most times.
    pub(crate) rows: u64,
    /// Step from one time to the next, in microseconds.
    pub(crate) step: i64,
}

/// Successive rows of a file with the same time.
struct Run {
    first: usize,
    end: usize,
    time: i64,
    /// Number of rows of the run that have a time.
    rows: u64,
}

impl SharedTimes {
    /// Measures the repetition of distinct times, in microseconds and in the order of the file; `counts` is the number
    /// of rows per time. Returns `None` if most times have one row, or their numbers of rows differ.
    pub(crate) fn of(times: &[i64], mut counts: Vec<u64>) -> Option<Self> {
        if times.len() < FEWEST {
            return None;
        }
        let steps = times.windows(2).map(|pair| pair[1].saturating_sub(pair[0]));
        let mut steps: Vec<i64> = steps.filter(|&step| step > 0).collect();
        counts.sort_unstable();
        steps.sort_unstable();
        let rows = counts[counts.len() / 2];
        let alike = counts
            .iter()
            .filter(|&&count| count.abs_diff(rows) as f64 <= TOLERANCE * rows as f64)
            .count();
        let step = *steps.get(steps.len() / 2)?;
        let is_regular = rows > 1 && alike as f64 >= ALIKE * counts.len() as f64;
        is_regular.then_some(Self { rows, step })
    }

    /// Returns a sentence that explains how such rows are read.
    pub(crate) fn told(self) -> String {
        format!(
            "rows that share a time (about {} of each) are put {} s apart",
            self.rows,
            self.spacing() as f64 / 1e6
        )
    }

    /// Returns the step from one row to the next, in microseconds.
    pub(crate) fn spacing(self) -> i64 {
        (self.step / self.rows as i64).max(1)
    }
}

/// Spreads rows that share a time evenly after it, in the order of the file, and never up to the next time. Returns how
/// times repeated, or `None` if they do not repeat and nothing was changed.
pub(crate) fn spread(times: &mut [i64]) -> Option<SharedTimes> {
    let runs = runs(times);
    let different: Vec<i64> = runs.iter().map(|run| run.time).collect();
    let shared = SharedTimes::of(&different, runs.iter().map(|run| run.rows).collect())?;
    for (at, run) in runs.iter().enumerate() {
        let ahead = runs.get(at + 1).map_or(shared.step, |next| next.time.saturating_sub(run.time));
        let room = if ahead > 0 { ahead } else { shared.step };
        let spacing = shared.spacing().min(room / run.rows as i64).max(1);
        let there = times[run.first..run.end].iter_mut().filter(|time| **time != NO_TIME);
        for (row, time) in there.enumerate() {
            *time = time.saturating_add(spacing.saturating_mul(row as i64));
        }
    }
    Some(shared)
}

fn runs(times: &[i64]) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    for (row, &time) in times.iter().enumerate().filter(|(_, time)| **time != NO_TIME) {
        match runs.last_mut() {
            Some(run) if run.time == time => {
                run.end = row + 1;
                run.rows += 1;
            }
            _ => runs.push(Run { first: row, end: row + 1, time, rows: 1 }),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOUR: i64 = 3_600_000_000;

    /// Returns 180 rows per hour; the first hour lacks six.
    fn hours(count: i64) -> Vec<i64> {
        let mut times: Vec<i64> =
            (0..count).flat_map(|hour| std::iter::repeat_n(hour * HOUR, 180)).collect();
        times.drain(..6);
        times
    }

    #[test]
    fn rows_of_an_hour_are_spread_over_it() {
        let mut times = hours(24);
        times[400] = NO_TIME;
        let found = spread(&mut times).expect("180 rows an hour");
        assert_eq!(found, SharedTimes { rows: 180, step: HOUR });
        assert_eq!(found.spacing(), 20_000_000);
        assert_eq!(times[..3], [0, 20_000_000, 40_000_000]);
        assert_eq!(times[174..177], [HOUR, HOUR + 20_000_000, HOUR + 40_000_000]);
        assert_eq!(
            (times[399], times[400], times[401]),
            (2 * HOUR + 45 * 20_000_000, NO_TIME, 2 * HOUR + 46 * 20_000_000)
        );
        assert!(times.windows(2).all(|pair| pair.contains(&NO_TIME) || pair[0] < pair[1]));
    }

    #[test]
    fn an_hour_with_more_rows_than_others_stays_in_its_hour() {
        let mut times = hours(20);
        times.splice(174..174, std::iter::repeat_n(HOUR, 10));
        spread(&mut times).expect("as most hours");
        assert!(times.windows(2).all(|pair| pair[0] < pair[1]));
    }

    #[test]
    fn times_of_one_row_and_uneven_repeats_stay_as_they_are() {
        let mut single: Vec<i64> = (0..50).map(|hour| hour * HOUR).collect();
        single[10] = single[9];
        let mut uneven: Vec<i64> = (0..40)
            .flat_map(|hour| std::iter::repeat_n(hour * HOUR, 1 + hour as usize % 7))
            .collect();
        for times in [&mut single, &mut uneven] {
            let before = times.clone();
            assert_eq!(spread(times), None);
            assert_eq!(*times, before);
        }
        assert_eq!(spread(&mut [0, 0, HOUR, HOUR]), None, "two times tell no rhythm");
    }
}
