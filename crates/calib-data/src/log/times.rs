//! The timestamps of one file.

use std::ops::Range;

use polars::prelude as pl;

use super::{
    clock::Clock,
    file::{FieldKind, LogFile},
    head::{Head, HeadColumn},
    rows::NO_TIME,
    values::RawColumn,
};
use crate::{
    DataConfig, DataError, TimestampUnit,
    text::{Notation, compact_pattern, is_time_of_day},
    time::Stamp,
};

/// What to say of a file without a timestamp column that is known.
pub(crate) fn no_timestamp(head: &Head, data: &DataConfig) -> DataError {
    let columns = head.columns();
    let list = |keep: &dyn Fn(&HeadColumn) -> bool| {
        let columns = columns.iter().filter(|column| keep(column));
        columns.map(|column| column.name.as_str()).collect::<Vec<_>>().join(", ")
    };
    let likely = list(&|column| {
        let name = column.name.to_lowercase();
        column.kind == FieldKind::Time || name.contains("time") || name.contains("date")
    });
    let candidates = if likely.is_empty() { list(&|_| true) } else { likely };
    DataError::NoTimestamp {
        path: head.path().to_owned(),
        column: data.timestamp.clone(),
        candidates,
    }
}

/// Refuse a text file with dates in the column `time` and times of day in another one: all rows of a day would be one.
pub(crate) fn refuse_dates_apart(head: &Head, time: usize) -> Result<(), DataError> {
    let Head::Text(file) = head else { return Ok(()) };
    let dates = file.dialect.cells(time);
    // A log with a row a day may have durations beside its dates.
    let repeats = dates.windows(2).any(|pair| pair[0] == pair[1]);
    if !repeats || dates.iter().any(|date| date.contains(':')) {
        return Ok(());
    }
    let is_clock = |&column: &usize| {
        let cells = file.dialect.cells(column);
        !cells.is_empty() && cells.iter().all(|cell| is_time_of_day(cell))
    };
    let columns = file.columns();
    match (0..columns.len()).find(is_clock) {
        None => Ok(()),
        Some(clock) => Err(DataError::BadTimestamp {
            path: file.path.clone(),
            column: columns[time].name.clone(),
            reason: format!(
                "it has dates, such as {}, and {:?} has the times of day; write both into one column, such as 2022-11-01 06:00:00",
                dates[0], columns[clock].name
            ),
        }),
    }
}

/// Times of a slice of a Parquet file, as its type has them.
pub(crate) enum Times {
    Stamps(Vec<Option<Stamp>>),
    /// Numbers of a unit that all of them tell; [`NO_TIME`] where there is none.
    Integers(Vec<i64>),
    Floats(Vec<f64>),
}

impl Times {
    /// Of a column whose first row is row `start` of the file.
    pub(crate) fn of(
        column: &RawColumn,
        file: &LogFile,
        data: &DataConfig,
        start: usize,
    ) -> Result<Self, DataError> {
        let bad = |column: &pl::Column, reason: String| DataError::BadTimestamp {
            path: file.path().to_owned(),
            column: column.name().to_string(),
            reason,
        };
        let RawColumn::Polars(column) = column else {
            return Ok(Self::Stamps(Vec::new()));
        };
        let damaged = |error: pl::PolarsError| file.damaged(&error);
        Ok(match column.dtype() {
            pl::DataType::Datetime(unit, zone) => {
                let physical = column.datetime().map_err(damaged)?.physical();
                let micros = |time: i64| match unit {
                    pl::TimeUnit::Milliseconds => time.saturating_mul(1_000),
                    pl::TimeUnit::Microseconds => time,
                    pl::TimeUnit::Nanoseconds => time.div_euclid(1_000),
                };
                let stamp = |time| match zone {
                    Some(_) => Stamp::Instant(micros(time)),
                    None => Stamp::Wall(micros(time)),
                };
                Self::Stamps(physical.iter().map(|time| time.map(stamp)).collect())
            }
            pl::DataType::Date => {
                let days = column.date().map_err(damaged)?.physical();
                let stamp = |day: i32| Stamp::Wall(i64::from(day) * 86_400_000_000);
                Self::Stamps(days.iter().map(|day| day.map(stamp)).collect())
            }
            pl::DataType::String | pl::DataType::Categorical(..) | pl::DataType::Enum(..) => {
                let text = column.cast(&pl::DataType::String).map_err(damaged)?;
                let stamps = text_stamps(text.str().map_err(damaged)?, data, start);
                Self::Stamps(stamps.map_err(|reason| bad(column, reason))?)
            }
            dtype if dtype.is_integer() => {
                let column = column.cast(&pl::DataType::Int64).map_err(damaged)?;
                let values = column.i64().map_err(damaged)?;
                let numbers: Vec<Option<i64>> = values.iter().collect();
                match dates(&numbers, data).map_err(|reason| bad(&column, reason))? {
                    Some(dates) => Self::Stamps(dates),
                    None => Self::Integers(
                        numbers.into_iter().map(|number| number.unwrap_or(NO_TIME)).collect(),
                    ),
                }
            }
            dtype if dtype.is_float() => {
                let column = column.cast(&pl::DataType::Float64).map_err(damaged)?;
                let values = column.f64().map_err(damaged)?;
                // Missing values make whole numbers into floats.
                let numbers: Vec<Option<f64>> =
                    values.iter().map(|value| value.filter(|value| value.is_finite())).collect();
                match dates(&numbers, data).map_err(|reason| bad(&column, reason))? {
                    Some(dates) => Self::Stamps(dates),
                    None => Self::Floats(
                        numbers.into_iter().map(|number| number.unwrap_or(f64::NAN)).collect(),
                    ),
                }
            }
            _ => {
                let field = file.field(column.name()).map(|field| &file.fields[field].type_name);
                return Err(bad(
                    column,
                    format!(
                        "it is of type {}; expected a datetime, a date, numbers or text",
                        field.map_or("", String::as_str)
                    ),
                ));
            }
        })
    }

    /// The times; the first numbers that are met tell the unit of all.
    pub(crate) fn stamps(self, unit: &mut Option<TimestampUnit>) -> Vec<Option<Stamp>> {
        let stamps = |micros: Vec<i64>| {
            let stamp = |micros| (micros != NO_TIME).then_some(Stamp::Instant(micros));
            micros.into_iter().map(stamp).collect()
        };
        match self {
            Self::Stamps(stamps) => stamps,
            Self::Integers(integers) => {
                let known = *unit.get_or_insert_with(|| unit_of_integers(&integers));
                stamps(from_integers(integers, Some(known)))
            }
            Self::Floats(floats) => {
                let known = *unit.get_or_insert_with(|| unit_of_floats(&floats));
                stamps(from_floats(&floats, Some(known)))
            }
        }
    }
}

/// Times that are text, of which the first is that of row `start`.
fn text_stamps(
    text: &pl::StringChunked,
    data: &DataConfig,
    start: usize,
) -> Result<Vec<Option<Stamp>>, String> {
    let (notation, expected) = match &data.timestamp_format {
        Some(pattern) => (Notation::Pattern(pattern.clone()), "what data.timestamp_format says"),
        None => (Notation::Iso, "ISO 8601, such as 2022-11-01T06:00:00 or 2022-11-01T06:00:00Z"),
    };
    let stamp = |(row, text): (usize, Option<&str>)| {
        match text.map(str::trim) {
        None | Some("") => Ok(None),
        Some(text) => notation.read(text).map(Some).ok_or_else(|| {
            format!(
                "row {} is {text:?}; expected {expected}, or data.timestamp_format to say how times are written",
                start + row
            )
        }),
    }
    };
    text.iter().enumerate().map(stamp).collect()
}

/// Numbers that are dates, such as 20240301060000: where the study says how times are written, and not that they count since
/// 1970. None if they count.
fn dates<N: ToString>(
    numbers: &[Option<N>],
    data: &DataConfig,
) -> Result<Option<Vec<Option<Stamp>>>, String> {
    if data.timestamp_unit.is_some() {
        return Ok(None);
    }
    let Some(format) = &data.timestamp_format else {
        let first = numbers.iter().flatten().next().map(N::to_string);
        if first.is_none_or(|first| compact_pattern(&[&first]).is_none()) {
            return Ok(None);
        }
        let written: Vec<String> = numbers.iter().flatten().map(N::to_string).collect();
        let cells: Vec<&str> = written.iter().map(String::as_str).collect();
        return match compact_pattern(&cells) {
            None => Ok(None),
            Some(pattern) => Err(format!(
                "its numbers, such as {}, look like dates; set data.timestamp_format = \"{pattern}\" if they are, or data.timestamp_unit if they count since 1970",
                cells[0]
            )),
        };
    };
    let notation = Notation::Pattern(format.clone());
    let stamp = |number: &Option<N>| {
        let Some(number) = number.as_ref().map(N::to_string) else { return Ok(None) };
        notation.read(&number).map(Some).ok_or_else(|| {
            format!(
                "{number} is not what data.timestamp_format says; set data.timestamp_unit if it counts since 1970"
            )
        })
    };
    numbers.iter().map(stamp).collect::<Result<_, _>>().map(Some)
}

/// The timestamps of all rows in microseconds; [`NO_TIME`] where one is missing.
pub(crate) fn read_timestamps(
    file: &LogFile,
    field: usize,
    data: &DataConfig,
) -> Result<Vec<i64>, DataError> {
    if let Some(times) = file.stored_times() {
        return Ok(times);
    }
    let mut integers: Vec<i64> = Vec::new();
    let mut floats: Vec<f64> = Vec::new();
    let mut times = Vec::with_capacity(file.rows);
    let mut clock = Clock::new(Notation::Iso, data);
    for slice in file.slices(&(0..file.rows)) {
        let column = file.read(&[field], &slice)?.swap_remove(0);
        match Times::of(&column, file, data, slice.start)? {
            Times::Stamps(stamps) => {
                times.extend(stamps.into_iter().map(|stamp| clock.instant(stamp)));
            }
            Times::Integers(some) => integers.extend(some),
            Times::Floats(some) => floats.extend(some),
        }
    }
    if !integers.is_empty() {
        times = from_integers(integers, data.timestamp_unit);
    } else if !floats.is_empty() {
        times = from_floats(&floats, data.timestamp_unit);
    }
    for time in times.iter_mut().filter(|time| !CALENDAR.contains(time)) {
        *time = NO_TIME;
    }
    Ok(times)
}

fn unit_of_integers(times: &[i64]) -> TimestampUnit {
    let present = || times.iter().filter(|&&time| time != NO_TIME);
    let sizes = present().map(|time| time.unsigned_abs() as f64);
    guess_unit(typical(sizes, present().count()))
}

fn unit_of_floats(times: &[f64]) -> TimestampUnit {
    let finite = || times.iter().filter(|time| time.is_finite());
    guess_unit(typical(finite().map(|time| time.abs()), finite().count()))
}

fn from_integers(mut times: Vec<i64>, unit: Option<TimestampUnit>) -> Vec<i64> {
    let unit = unit.unwrap_or_else(|| unit_of_integers(&times));
    for time in times.iter_mut().filter(|time| **time != NO_TIME) {
        *time = unit.in_micros(*time);
    }
    times
}

fn from_floats(times: &[f64], unit: Option<TimestampUnit>) -> Vec<i64> {
    let micros = unit.unwrap_or_else(|| unit_of_floats(times)).micros();
    times
        .iter()
        .map(|&time| if time.is_finite() { (time * micros).round() as i64 } else { NO_TIME })
        .collect()
}

/// Years 1 to 9998, in microseconds. The year 9999, like the largest number there is, stands for "never" in databases,
/// and what is no instant is no row of a log.
pub(crate) const CALENDAR: Range<i64> = -62_135_596_800_000_000..253_370_764_800_000_000;

/// The (upper) median of `count` sizes, evenly thinned where there are many: a single number that stands for something
/// else must not tell the unit of all others.
pub(crate) fn typical(sizes: impl Iterator<Item = f64>, count: usize) -> f64 {
    let mut thinned: Vec<f64> = sizes.step_by(count / THINNED + 1).collect();
    let middle = thinned.len() / 2;
    if thinned.is_empty() {
        return 0.0;
    }
    *thinned.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Timestamps that are looked at for their unit.
const THINNED: usize = 1 << 16;

/// In seconds, 1e11 is the year 5138; in milliseconds it is 1973. The same holds for the other steps.
pub(crate) fn guess_unit(largest: f64) -> TimestampUnit {
    match largest {
        _ if largest < 1e11 => TimestampUnit::Seconds,
        _ if largest < 1e14 => TimestampUnit::Milliseconds,
        _ if largest < 1e17 => TimestampUnit::Microseconds,
        _ => TimestampUnit::Nanoseconds,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_unit_shows_in_the_magnitude() {
        let second = 1_667_282_400_i64;
        let micros = second * 1_000_000;
        for factor in [1, 1_000, 1_000_000, 1_000_000_000] {
            let number = second * factor;
            assert_eq!(from_integers(vec![0, NO_TIME, number], None), [0, NO_TIME, micros]);
            let floats = from_floats(&[f64::NAN, number as f64], None);
            assert_eq!(floats, [NO_TIME, micros]);
        }
        let sentinel = from_integers(vec![second, second + 1, i64::MAX], None);
        assert_eq!(sentinel[..2], [micros, micros + 1_000_000]);
        let odd = from_integers(vec![micros * 1_000 + 1_999], None);
        assert_eq!(odd, [micros + 1], "whole microseconds, no rounding through floats");
        let milliseconds = from_integers(vec![1_500], Some(TimestampUnit::Milliseconds));
        assert_eq!(milliseconds, [1_500_000]);
    }
}
