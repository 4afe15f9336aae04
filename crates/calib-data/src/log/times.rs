//! The timestamps of one file.

use std::ops::Range;

use calib_core::Timestamp;
use polars::prelude as pl;

use super::{file::LogFile, rows::NO_TIME};
use crate::{DataConfig, DataError, TimestampUnit, time::parse_time};

/// The position of the timestamp column.
pub(crate) fn timestamp_field(file: &LogFile, data: &DataConfig) -> Result<usize, DataError> {
    use super::file::FieldKind;
    file.field(&data.timestamp).ok_or_else(|| {
        let list = |keep: &dyn Fn(&super::file::Field) -> bool| {
            let names: Vec<&str> = file
                .fields
                .iter()
                .filter(|field| keep(field))
                .map(|field| field.name.as_str())
                .collect();
            names.join(", ")
        };
        let likely = list(&|field| {
            let name = field.name.to_lowercase();
            field.kind == FieldKind::Time || name.contains("time") || name.contains("date")
        });
        let candidates = if likely.is_empty() { list(&|_| true) } else { likely };
        DataError::NoTimestamp {
            path: file.path().to_owned(),
            column: data.timestamp.clone(),
            candidates,
        }
    })
}

/// The timestamps of all rows in microseconds; [`NO_TIME`] where one is missing.
pub(crate) fn read_timestamps(file: &LogFile, data: &DataConfig) -> Result<Vec<i64>, DataError> {
    let field = timestamp_field(file, data)?;
    let bad = |reason: String| DataError::BadTimestamp {
        path: file.path().to_owned(),
        column: data.timestamp.clone(),
        reason,
    };
    let mut integers: Vec<i64> = Vec::new();
    let mut floats: Vec<f64> = Vec::new();
    let mut times = Vec::with_capacity(file.rows);
    for slice in file.slices(&(0..file.rows)) {
        let column = file.read(&[field], &slice)?.swap_remove(0);
        let damaged = |error: pl::PolarsError| file.damaged(&error);
        match column.dtype() {
            pl::DataType::Datetime(unit, _) => {
                let physical = column.datetime().map_err(damaged)?.physical();
                times.extend(physical.iter().map(|time| match (time, unit) {
                    (None, _) => NO_TIME,
                    (Some(time), pl::TimeUnit::Milliseconds) => time.saturating_mul(1_000),
                    (Some(time), pl::TimeUnit::Microseconds) => time,
                    (Some(time), pl::TimeUnit::Nanoseconds) => time.div_euclid(1_000),
                }));
            }
            pl::DataType::Date => {
                let days = column.date().map_err(damaged)?.physical();
                times.extend(
                    days.iter()
                        .map(|day| day.map_or(NO_TIME, |day| i64::from(day) * 86_400_000_000)),
                );
            }
            pl::DataType::String | pl::DataType::Categorical(..) | pl::DataType::Enum(..) => {
                let text = column.cast(&pl::DataType::String).map_err(damaged)?;
                for (row, text) in text.str().map_err(damaged)?.iter().enumerate() {
                    times.push(match text.map(str::trim) {
                        None | Some("") => NO_TIME,
                        Some(text) => parse_time(text).map(Timestamp::as_micros).ok_or_else(|| {
                            bad(format!(
                                "row {} is {text:?}; expected ISO 8601, such as 2022-11-01T06:00:00 or 2022-11-01T06:00:00Z",
                                slice.start + row
                            ))
                        })?,
                    });
                }
            }
            dtype if dtype.is_integer() => {
                let column = column.cast(&pl::DataType::Int64).map_err(damaged)?;
                let values = column.i64().map_err(damaged)?;
                integers.extend(values.iter().map(|value| value.unwrap_or(NO_TIME)));
            }
            dtype if dtype.is_float() => {
                let column = column.cast(&pl::DataType::Float64).map_err(damaged)?;
                let values = column.f64().map_err(damaged)?;
                floats.extend(values.iter().map(|value| value.unwrap_or(f64::NAN)));
            }
            _ => {
                return Err(bad(format!(
                    "it is of type {}; expected a datetime, a date, numbers or text",
                    file.fields[field].type_name
                )));
            }
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

fn from_integers(mut times: Vec<i64>, unit: Option<TimestampUnit>) -> Vec<i64> {
    let present = || times.iter().filter(|&&time| time != NO_TIME);
    let unit = unit.unwrap_or_else(|| {
        let sizes = present().map(|time| time.unsigned_abs() as f64);
        guess_unit(typical(sizes, present().count()))
    });
    for time in times.iter_mut().filter(|time| **time != NO_TIME) {
        *time = match unit {
            TimestampUnit::Seconds => time.saturating_mul(1_000_000),
            TimestampUnit::Milliseconds => time.saturating_mul(1_000),
            TimestampUnit::Microseconds => *time,
            TimestampUnit::Nanoseconds => time.div_euclid(1_000),
        };
    }
    times
}

fn from_floats(times: &[f64], unit: Option<TimestampUnit>) -> Vec<i64> {
    let finite = || times.iter().filter(|time| time.is_finite());
    let typical = || typical(finite().map(|time| time.abs()), finite().count());
    let micros = match unit.unwrap_or_else(|| guess_unit(typical())) {
        TimestampUnit::Seconds => 1e6,
        TimestampUnit::Milliseconds => 1e3,
        TimestampUnit::Microseconds => 1.0,
        TimestampUnit::Nanoseconds => 1e-3,
    };
    times
        .iter()
        .map(|&time| if time.is_finite() { (time * micros).round() as i64 } else { NO_TIME })
        .collect()
}

/// Years 1 to 9998, in microseconds. The year 9999, like the largest number there is, stands for "never" in databases,
/// and what is no instant is no row of a log.
const CALENDAR: Range<i64> = -62_135_596_800_000_000..253_370_764_800_000_000;

/// The (upper) median of `count` sizes, evenly thinned where there are many: a single number that stands for something
/// else must not tell the unit of all others.
fn typical(sizes: impl Iterator<Item = f64>, count: usize) -> f64 {
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
fn guess_unit(largest: f64) -> TimestampUnit {
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
