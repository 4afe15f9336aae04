//! Which rows are for training and which are held out.

use std::ops::Range;

use calib_core::Timestamp;

use crate::{DataConfig, DataError, TimeRange, time::format_time};

/// The instants of the two ranges, half-open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Split {
    pub(crate) train: Range<i64>,
    pub(crate) held_out: Option<Range<i64>>,
}

impl Split {
    /// The ranges for a log whose first and last rows are at `first` and `last`.
    pub(crate) fn new(data: &DataConfig, first: i64, last: i64) -> Result<Self, DataError> {
        let Some(train) = &data.train else {
            return Ok(Self::by_fraction(data.train_fraction, first, last));
        };
        let range = |key: &'static str, range: &TimeRange| {
            let start = range.start.as_ref().map_or(first, |at| at.instant().as_micros());
            let end = range.end.as_ref().map_or(last + 1, |at| at.instant().as_micros());
            if start > last || end <= first || start >= end {
                let at = |micros| format_time(Timestamp::from_micros(micros));
                return Err(DataError::OutsideData {
                    key,
                    range: range.to_string(),
                    start: at(first),
                    end: at(last),
                });
            }
            Ok(start..end)
        };
        let split = Self {
            train: range("train", train)?,
            held_out: data
                .held_out
                .as_ref()
                .map(|held_out| range("held_out", held_out))
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

    /// From the earliest to the latest instant of either range.
    pub(crate) fn window(&self) -> Range<i64> {
        let held_out = self.held_out.as_ref().unwrap_or(&self.train);
        self.train.start.min(held_out.start)..self.train.end.max(held_out.end)
    }
}

/// The rows whose times lie in `range`.
pub(crate) fn rows_in(timestamps: &[Timestamp], range: &Range<i64>) -> Range<usize> {
    let before = |limit: i64| timestamps.partition_point(|time| time.as_micros() < limit);
    before(range.start)..before(range.end)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Moment;

    fn range(start: &str, end: &str) -> TimeRange {
        let moment = |text: &str| (!text.is_empty()).then(|| Moment::new(text).expect("a time"));
        TimeRange { start: moment(start), end: moment(end) }
    }

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

    #[test]
    fn ranges_are_half_open_and_may_be_open_ended() {
        let data = DataConfig {
            train: Some(range("", "1970-01-03")),
            held_out: Some(range("1970-01-03", "")),
            ..DataConfig::default()
        };
        let split = Split::new(&data, DAY, 4 * DAY).expect("valid");
        assert_eq!(split.train, DAY..2 * DAY);
        assert_eq!(split.held_out, Some(2 * DAY..4 * DAY + 1));
    }

    #[test]
    fn overlaps_and_ranges_outside_the_data_are_refused() {
        let mut data = DataConfig {
            train: Some(range("1970-01-02", "1970-01-04")),
            held_out: Some(range("1970-01-03T12:00:00", "1970-01-05")),
            ..DataConfig::default()
        };
        let message = |data: &DataConfig| {
            let error = Split::new(data, DAY, 3 * DAY).expect_err("refused");
            error.to_string()
        };
        let overlap = message(&data);
        assert!(
            overlap.contains("(1970-01-02 .. 1970-01-04)")
                && overlap.contains("(1970-01-03T12:00:00 .. 1970-01-05)"),
            "{overlap}"
        );
        data.held_out = Some(range("1971-01-01", ""));
        assert_eq!(
            message(&data),
            "data.held_out (1971-01-01 .. end of the log) holds no rows: the log runs from 1970-01-02 00:00:00 to 1970-01-04 00:00:00"
        );
    }
}
