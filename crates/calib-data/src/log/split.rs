//! Splits the log into the training and the held-out range.

use std::ops::Range;

use calib_core::Timestamp;
use calib_text::format_time;

use crate::{DataConfig, DataError, TimeRange};

/// The instants of the two ranges, half-open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Split {
    pub(crate) train: Range<i64>,
    pub(crate) held_out: Option<Range<i64>>,
}

impl Split {
    /// Returns the ranges for a log whose first and last rows are at `first` and `last`.
    pub(crate) fn new(data: &DataConfig, first: i64, last: i64) -> Result<Self, DataError> {
        let Some(train) = &data.train else {
            return Ok(Self::by_fraction(data.train_fraction, first, last));
        };
        let held_out = data.held_out.as_ref();
        let split = Self {
            train: instants("train", train, data, (first, last))?,
            held_out: held_out
                .map(|held_out| instants("held_out", held_out, data, (first, last)))
                .transpose()?,
        };
        if let (Some(instants), Some(held_out)) = (&split.held_out, &data.held_out)
            && instants.start < split.train.end
            && split.train.start < instants.end
        {
            return Err(DataError::Overlap {
                train: train.to_string(),
                held_out: held_out.to_string(),
            });
        }
        Ok(split)
    }

    fn by_fraction(fraction: f64, first: i64, last: i64) -> Self {
        let end = last + 1;
        if fraction >= 1.0 {
            return Self { train: first..end, held_out: None };
        }
        let span = (last - first) as f64;
        let boundary = (first + (span * fraction).round() as i64).clamp(first + 1, end);
        Self { train: first..boundary, held_out: (boundary < end).then_some(boundary..end) }
    }

    /// Returns the ranges in order of time, cut to the first and the last instant of the log.
    pub(crate) fn ranges_inside(&self, (first, last): (i64, i64)) -> Vec<Range<i64>> {
        let mut ranges: Vec<Range<i64>> =
            [&self.train].into_iter().chain(&self.held_out).cloned().collect();
        ranges.sort_by_key(|range| range.start);
        // A row after the last sample may still have its value.
        ranges.iter().map(|range| range.start.max(first)..range.end.min(last + 1)).collect()
    }

    /// Returns the span from the earliest to the latest instant of either range.
    pub(crate) fn window(&self) -> Range<i64> {
        let held_out = self.held_out.as_ref().unwrap_or(&self.train);
        self.train.start.min(held_out.start)..self.train.end.max(held_out.end)
    }
}

/// Returns the instants of a range of the study, in a log from `first` to `last`.
fn instants(
    key: &'static str,
    range: &TimeRange,
    data: &DataConfig,
    (first, last): (i64, i64),
) -> Result<Range<i64>, DataError> {
    let start = range.start.as_ref().map_or(first, |at| data.instant(at).as_micros());
    let end = range.end.as_ref().map_or(last + 1, |at| data.instant(at).as_micros());
    if start > last || end <= first || start >= end {
        return Err(outside_data(key, Some(range), (first, last)));
    }
    Ok(start..end)
}

/// Returns the error that a range holds no rows of a log from `first` to `last`.
fn outside_data(
    key: &'static str,
    range: Option<&TimeRange>,
    (first, last): (i64, i64),
) -> DataError {
    let range = range.map_or_else(String::new, ToString::to_string);
    let [start, end] = [first, last].map(|micros| format_time(Timestamp::from_micros(micros)));
    DataError::OutsideData { key, range, start, end }
}

pub(crate) fn rows_in(timestamps: &[Timestamp], range: &Range<i64>) -> Range<usize> {
    let start = timestamps.partition_point(|time| time.as_micros() < range.start);
    let end = timestamps.partition_point(|time| time.as_micros() < range.end);
    start..end
}

/// Returns the rows of the two ranges. `span` has the first and the last instant of the log, in microseconds.
pub(super) fn row_ranges(
    data: &DataConfig,
    split: &Split,
    timestamps: &[Timestamp],
    span: (i64, i64),
) -> Result<(Range<usize>, Option<Range<usize>>), DataError> {
    let train = rows_in(timestamps, &split.train);
    if train.is_empty() {
        return Err(outside_data("train", data.train.as_ref(), span));
    }
    let held_out = split.held_out.as_ref().map(|range| rows_in(timestamps, range));
    if held_out.as_ref().is_some_and(Range::is_empty) {
        return Err(outside_data("held_out", data.held_out.as_ref(), span));
    }
    Ok((train, held_out))
}

/// Rejects ranges by a fraction of the *time* that leave one range almost without rows, because most of the time lies
/// in one gap. Rows at a placeholder date (1970, 2999) stretch the log, and all other rows fall into one range.
pub(crate) fn refuse_lopsided(
    fraction: f64,
    timestamps: &[Timestamp],
    train: &Range<usize>,
    held_out: &Range<usize>,
) -> Result<(), DataError> {
    let Some(longest) = timestamps.windows(2).max_by_key(|pair| step(pair)) else { return Ok(()) };
    let first = timestamps[0];
    let last = timestamps[timestamps.len() - 1];
    let most_of_it = step(longest) > last.as_micros().saturating_sub(first.as_micros()) / 2;
    let rows = (train.len() + held_out.len()) as f64;
    let lacks_rows = [(train, fraction), (held_out, 1.0 - fraction)]
        .into_iter()
        .any(|(part, share)| (part.len() as f64) < LEAST_SHARE * share * rows);
    if most_of_it && lacks_rows {
        return Err(DataError::Lopsided {
            train: train.len(),
            held_out: held_out.len(),
            gap: [longest[0], longest[1]].map(format_time),
        });
    }
    Ok(())
}

/// Returns the microseconds from one row to the next.
fn step(pair: &[Timestamp]) -> i64 {
    pair[1].as_micros().saturating_sub(pair[0].as_micros())
}

/// A range is too small if it has less than this share of the rows that its share of the time would give.
const LEAST_SHARE: f64 = 0.01;

#[cfg(test)]
mod tests {
    use super::*;

    const DAY: i64 = 86_400_000_000;

    #[test]
    fn a_fraction_of_the_time_span_is_for_training() {
        let data = DataConfig::default();
        let split = Split::new(&data, 100, 1100).expect("valid");
        assert_eq!(split.train, 100..900);
        assert_eq!(split.held_out, Some(900..1101));
        assert_eq!(split.window(), 100..1101);
        let whole = DataConfig { train_fraction: 1.0, ..data.clone() };
        assert_eq!(Split::new(&whole, 100, 1100).expect("valid").held_out, None);
        let one_row = Split::new(&data, 100, 100).expect("valid");
        assert_eq!((one_row.train, one_row.held_out), (100..101, None));
    }

    /// Checks whether rows may be divided after the first `train`.
    fn divided(times: &[Timestamp], train: usize) -> Result<(), String> {
        let held_out = train..times.len();
        refuse_lopsided(0.8, times, &(0..train), &held_out).map_err(|error| error.to_string())
    }

    #[test]
    fn a_date_that_stands_for_something_else_is_told() {
        let mut times: Vec<Timestamp> =
            (1..1000).map(|hour| Timestamp::from_micros(DAY * 20_000 + hour * DAY / 24)).collect();
        assert_eq!(divided(&times, 998), Ok(()), "no gap");
        times.push(Timestamp::from_micros(DAY * 370_000));
        let late = divided(&times, 999).expect_err("2983");
        assert!(late.contains("999 rows") && late.contains("If the time 2983-"), "{late}");
        times.pop();
        times.insert(0, Timestamp::from_micros(0));
        let early = divided(&times, 1).expect_err("1970");
        assert!(early.contains("If the time 1970-01-01"), "{early}");
        assert_eq!(divided(&times, 500), Ok(()), "two periods far apart");
    }
}
