//! Reads the timestamps of one file.

use calib_text::{ParsedTime, unit_readings, units};
use polars::prelude as pl;

use super::{
    clock::Clock,
    column_aliases::{TIME_FIELDS, TIMES, plain},
    file::{FieldKind, LogFile},
    head::{Head, mostly},
    rows::NO_TIME,
    values::RawColumn,
};
use crate::{
    DataConfig, DataError, TimestampUnit,
    text::{Candidates, Notation, TextFile, compact_pattern, is_time_of_day, shown},
};

/// Returns the columns of a file that may hold its times, by their kind or name.
pub(crate) fn likely_times(head: &Head) -> Vec<String> {
    head.columns()
        .into_iter()
        .filter(|column| {
            let name = column.name.to_lowercase();
            column.kind == FieldKind::Time || name.contains("time") || name.contains("date")
        })
        .map(|column| column.name)
        .collect()
}

/// Returns the error for a file without a known timestamp column. `others` is the number of files that have one.
pub(crate) fn no_timestamp(head: &Head, others: usize, data: &DataConfig) -> DataError {
    let likely = likely_times(head);
    let set = match likely.first() {
        Some(first) => format!(
            "set data.timestamp to one of: {} (--set {})",
            likely.join(", "),
            shell_word(&format!("data.timestamp={first}"))
        ),
        None => "no column looks like a time: set data.timestamp to its name (--set data.timestamp=NAME)".to_owned(),
    };
    let is_default = data.timestamp == DataConfig::default().timestamp;
    let split = if is_default { parts_of_dates(head) } else { Vec::new() };
    let remedy = if others > 0 {
        let have = if others == 1 { "file has" } else { "files have" };
        format!("{others} other {have} one: leave this file out of data.path, or {set}")
    } else if let [first, .., last] = &split[..] {
        format!(
            "{set}. The columns {first} to {last} look like parts of a date, but calib joins them only if they are numbers in a text file, with a year of four digits: write them into one column"
        )
    } else if likely.is_empty() {
        format!(
            "{set}; or, if the log has no times, set data.period_secs to the seconds from row to row (--set data.period_secs=60)"
        )
    } else {
        set
    };
    DataError::NoTimestamp { path: head.path().to_owned(), column: data.timestamp.clone(), remedy }
}

/// Puts a word in quotes if a shell would split it.
fn shell_word(word: &str) -> String {
    if word.chars().all(|letter| letter.is_alphanumeric() || "._-=/:".contains(letter)) {
        word.to_owned()
    } else {
        format!("'{word}'")
    }
}

/// Returns the names of the columns called year, month and day, and of those of hour, minute and second as far as they
/// exist. Returns an empty list if one of the first three is missing.
fn parts_of_dates(head: &Head) -> Vec<String> {
    let columns = head.columns();
    let found = TIME_FIELDS
        .iter()
        .map_while(|names| {
            columns.iter().find(|column| names.contains(&plain(&column.name).as_str()))
        })
        .map(|column| column.name.clone());
    Some(found.collect::<Vec<_>>()).filter(|found| found.len() >= 3).unwrap_or_default()
}

/// Joins the columns of a text file called year, month, day and, as far as they exist, hour, minute and second, if
/// their cells are valid. Returns the column that stands for all of them.
pub(crate) fn join_fields(head: &mut Head) -> Option<usize> {
    const RANGES: [[f64; 2]; 6] =
        [[1900.0, 2200.0], [1.0, 12.0], [1.0, 31.0], [0.0, 23.0], [0.0, 59.0], [0.0, 59.0]];
    let names = parts_of_dates(head);
    let Head::Text(file) = head else { return None };
    let fields: Vec<usize> = names
        .iter()
        .filter_map(|name| file.columns().iter().position(|column| column.name == *name))
        .collect();
    let mut ranged = fields.iter().zip(RANGES);
    if fields.len() < 3
        || !ranged.all(|(&column, range)| are_whole_in(range, &file.dialect.cells(column)))
    {
        return None;
    }
    file.join_fields(&fields);
    Some(fields[0])
}

/// Whether there are cells and all are whole numbers from `low` to `high`.
fn are_whole_in([low, high]: [f64; 2], cells: &[&str]) -> bool {
    !cells.is_empty()
        && cells.iter().all(|cell| {
            cell.parse::<f64>()
                .is_ok_and(|number| number.fract() == 0.0 && (low..=high).contains(&number))
        })
}

/// Joins the dates in one column of a text file and the times of day in another. `time` is either of them. Returns the
/// column of dates.
pub(crate) fn join_times(head: &mut Head, time: usize) -> Result<usize, DataError> {
    let Head::Text(file) = head else { return Ok(time) };
    let mut others = (0..file.columns().len()).filter(|&column| column != time);
    let (date, clock) = if time < file.columns().len() && has_clock(file, time) {
        let date = others.find(|&column| {
            mostly(&file.dialect.cells(column), is_date) && !has_clock(file, column)
        });
        let Some(date) = date else { return Ok(time) };
        (date, time)
    } else {
        // A log with one row per day may have durations beside its dates.
        let dates = file.dialect.cells(time);
        let repeats = dates.windows(2).any(|pair| pair[0] == pair[1]);
        if !repeats || !mostly(&dates, |cell| !cell.contains(':')) {
            return Ok(time);
        }
        let clocks: Vec<usize> = others.filter(|&column| has_clock(file, column)).collect();
        match (
            &clocks[..],
            clocks
                .iter()
                .find(|column| TIMES.contains(&plain(&file.columns()[**column].name).as_str())),
        ) {
            ([], _) => return Ok(time),
            ([clock], _) | (_, Some(clock)) => (time, *clock),
            _ => {
                let names = clocks.iter().map(|&column| file.columns()[column].name.as_str());
                return Err(DataError::BadTimestamp {
                    path: file.path.clone(),
                    column: file.columns()[time].name.clone(),
                    reason: format!(
                        "it has dates, such as {}, and several columns have times of day ({}); call the one that belongs to it \"Time\"",
                        shown(dates[0]),
                        names.collect::<Vec<_>>().join(", ")
                    ),
                });
            }
        }
    };
    file.join_times(date, clock);
    Ok(date)
}

/// Whether most cells of a column are times of day.
fn has_clock(file: &TextFile, column: usize) -> bool {
    mostly(&file.dialect.cells(column), is_time_of_day)
}

/// Whether a cell is a date without a time of day, and not a number.
fn is_date(cell: &str) -> bool {
    let found = Candidates::of(&[cell], None).left;
    !cell.contains(':') && found.iter().any(|notation| !matches!(notation, Notation::Number(_)))
}

/// Times of a slice of a Parquet file, by their type.
pub(crate) enum Times {
    Stamps(Vec<Option<ParsedTime>>),
    /// Numbers whose unit depends on all of them; [`NO_TIME`] for a missing time.
    Integers(Vec<i64>),
    Floats(Vec<f64>),
}

fn in_micros(time: i64, unit: pl::TimeUnit) -> i64 {
    match unit {
        pl::TimeUnit::Milliseconds => time.saturating_mul(1_000),
        pl::TimeUnit::Microseconds => time,
        pl::TimeUnit::Nanoseconds => time.div_euclid(1_000),
    }
}

impl Times {
    /// Reads a column whose first row is row `start` of the file.
    pub(crate) fn of(
        column: &RawColumn,
        file: &LogFile,
        data: &DataConfig,
        start: usize,
    ) -> Result<Self, DataError> {
        let RawColumn::Polars(column) = column else {
            return Ok(Self::Stamps(Vec::new()));
        };
        Ok(match column.dtype() {
            pl::DataType::Datetime(unit, zone) => {
                let physical = column.datetime().map_err(|error| file.damaged(&error))?.physical();
                let micros = physical.iter().map(|time| time.map(|time| in_micros(time, *unit)));
                Self::Stamps(match zone {
                    Some(_) => micros.map(|time| time.map(ParsedTime::Instant)).collect(),
                    None => micros.map(|time| time.map(ParsedTime::Wall)).collect(),
                })
            }
            pl::DataType::Date => {
                let days = column.date().map_err(|error| file.damaged(&error))?.physical();
                let midnights = days
                    .iter()
                    .map(|day| day.map(|day| ParsedTime::Wall(i64::from(day) * 86_400_000_000)));
                Self::Stamps(midnights.collect())
            }
            pl::DataType::String | pl::DataType::Categorical(..) | pl::DataType::Enum(..) => {
                let text =
                    column.cast(&pl::DataType::String).map_err(|error| file.damaged(&error))?;
                let stamps =
                    text_stamps(text.str().map_err(|error| file.damaged(&error))?, data, start);
                Self::Stamps(stamps.map_err(|reason| unreadable_column(file, column, reason))?)
            }
            dtype if dtype.is_integer() => {
                let column =
                    column.cast(&pl::DataType::Int64).map_err(|error| file.damaged(&error))?;
                let values = column.i64().map_err(|error| file.damaged(&error))?;
                let numbers: Vec<Option<i64>> = values.iter().collect();
                match dates(&numbers, data)
                    .map_err(|reason| unreadable_column(file, &column, reason))?
                {
                    Some(dates) => Self::Stamps(dates),
                    None => Self::Integers(
                        numbers.into_iter().map(|number| number.unwrap_or(NO_TIME)).collect(),
                    ),
                }
            }
            dtype if dtype.is_float() => {
                let column =
                    column.cast(&pl::DataType::Float64).map_err(|error| file.damaged(&error))?;
                let values = column.f64().map_err(|error| file.damaged(&error))?;
                // Missing values turn whole numbers into floats.
                let numbers: Vec<Option<f64>> =
                    values.iter().map(|value| value.filter(|value| value.is_finite())).collect();
                match dates(&numbers, data)
                    .map_err(|reason| unreadable_column(file, &column, reason))?
                {
                    Some(dates) => Self::Stamps(dates),
                    None => Self::Floats(
                        numbers.into_iter().map(|number| number.unwrap_or(f64::NAN)).collect(),
                    ),
                }
            }
            _ => {
                let field = file.field(column.name()).map(|field| &file.fields[field].type_name);
                let reason = format!(
                    "it is of type {}; expected a datetime, a date, numbers or text",
                    field.map_or("", String::as_str)
                );
                return Err(unreadable_column(file, column, reason));
            }
        })
    }

    /// Returns the times. The first numbers determine the unit of all. `field` is their column.
    pub(crate) fn stamps(
        self,
        unit: &mut Option<TimestampUnit>,
        file: &LogFile,
        field: usize,
    ) -> Result<Vec<Option<ParsedTime>>, DataError> {
        Ok(match self {
            Self::Stamps(stamps) => stamps,
            Self::Integers(integers) => {
                let there = integers.iter().filter(|&&number| number != NO_TIME);
                let numbers = there.map(|&number| number as f64);
                let unit = known_unit(unit, || numbers.collect(), file, field)?;
                integers
                    .into_iter()
                    .map(|number: i64| {
                        (number != NO_TIME).then(|| unit.stamp(unit.whole_in_micros(number)))
                    })
                    .collect()
            }
            Self::Floats(floats) => {
                let unit = known_unit(unit, || floats.clone(), file, field)?;
                floats
                    .into_iter()
                    .map(|number: f64| {
                        number.is_finite().then(|| unit.stamp(unit.in_micros(number)))
                    })
                    .collect()
            }
        })
    }
}

/// Returns the error that a column of a Parquet file does not hold timestamps.
fn unreadable_column(file: &LogFile, column: &pl::Column, reason: String) -> DataError {
    DataError::BadTimestamp {
        path: file.path().to_owned(),
        column: column.name().to_string(),
        reason,
    }
}

/// Returns `unit` if it is known. Otherwise the numbers in the column `field` determine it.
fn known_unit(
    unit: &mut Option<TimestampUnit>,
    numbers: impl FnOnce() -> Vec<f64>,
    file: &LogFile,
    field: usize,
) -> Result<TimestampUnit, DataError> {
    let known = unit.map_or_else(|| unit_of(&numbers(), file, field), Ok)?;
    Ok(*unit.insert(known))
}

/// Returns the unit of the numbers in the column `field`, if they determine it.
fn unit_of(numbers: &[f64], file: &LogFile, field: usize) -> Result<TimestampUnit, DataError> {
    let found = units(numbers).map_err(|reason| DataError::BadTimestamp {
        path: file.path().to_owned(),
        column: file.fields[field].name.clone(),
        reason,
    })?;
    if let [unit] = found[..] {
        return Ok(unit);
    }
    let example = numbers.first().map_or_else(String::new, f64::to_string);
    Err(DataError::AmbiguousTimes {
        path: file.path().to_owned(),
        readings: unit_readings(&example, &found),
        example,
    })
}

/// Reads times from text; the first one belongs to row `start`.
fn text_stamps(
    text: &pl::StringChunked,
    data: &DataConfig,
    start: usize,
) -> Result<Vec<Option<ParsedTime>>, String> {
    let (notation, expected) = match &data.timestamp_format {
        Some(pattern) => (Notation::Pattern(pattern.clone()), "what data.timestamp_format says"),
        None => (Notation::Iso, "ISO 8601, such as 2022-11-01T06:00:00 or 2022-11-01T06:00:00Z"),
    };
    text.iter().enumerate().map(|(row, text)| {
        match text.map(str::trim) {
        None | Some("") => Ok(None),
        Some(text) => notation.read(text).map(Some).ok_or_else(|| {
            format!(
                "row {} is {}; expected {expected}, or data.timestamp_format to say how times are written",
                start + row,
                shown(text)
            )
        }),
    }
    }).collect()
}

/// Reads numbers that are dates, such as 20240301060000, if the study sets the notation of times and no unit. Returns
/// `None` if the numbers count units of time.
fn dates<N: ToString>(
    numbers: &[Option<N>],
    data: &DataConfig,
) -> Result<Option<Vec<Option<ParsedTime>>>, String> {
    if data.timestamp_unit.is_some() {
        return Ok(None);
    }
    let Some(format) = &data.timestamp_format else {
        let evenly = numbers.len() / LOOKED_AT + 1;
        let some = numbers.iter().step_by(evenly).flatten();
        let written: Vec<String> = some.map(N::to_string).collect();
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
    numbers.iter().map(|number| {
        let Some(number) = number.as_ref().map(N::to_string) else { return Ok(None) };
        notation.read(&number).map(Some).ok_or_else(|| {
            format!(
                "{number} is not what data.timestamp_format says; set data.timestamp_unit if it counts since 1970"
            )
        })
    }).collect::<Result<_, _>>().map(Some)
}

/// Number of values that are examined for dates.
const LOOKED_AT: usize = 1_000;

/// The timestamps of a file.
pub(crate) struct Read {
    /// Instants of all rows in microseconds; [`NO_TIME`] for a missing time.
    pub(crate) instants: Vec<i64>,
    /// Number of rows whose time names no instant, or two that no other row can tell apart.
    pub(crate) undecided: u64,
    /// Number of rows that `data.where` excludes. They have no time either.
    pub(crate) left_out: u64,
}

pub(crate) fn read_timestamps(
    file: &LogFile,
    field: usize,
    data: &DataConfig,
) -> Result<Read, DataError> {
    if let Some(instants) = file.stored_times() {
        return Ok(Read { instants, undecided: 0, left_out: 0 });
    }
    let mut integers: Vec<i64> = Vec::new();
    let mut floats: Vec<f64> = Vec::new();
    let mut instants = Vec::with_capacity(file.rows);
    let mut take = |(), instant: i64| -> Result<(), DataError> {
        instants.push(instant);
        Ok(())
    };
    let mut rows = Clock::new(Notation::Iso, data).rows();
    for slice in file.slices(&(0..file.rows)) {
        let column = file.read(&[field], &slice)?.swap_remove(0);
        match Times::of(&column, file, data, slice.start)? {
            Times::Stamps(stamps) => {
                stamps.into_iter().try_for_each(|stamp| rows.push(stamp, (), &mut take))?;
            }
            Times::Integers(some) => integers.extend(some),
            Times::Floats(some) => floats.extend(some),
        }
    }
    // All numbers together determine their unit.
    let numbers = if floats.is_empty() { Times::Integers(integers) } else { Times::Floats(floats) };
    let stamps = numbers.stamps(&mut data.timestamp_unit.clone(), file, field)?;
    stamps.into_iter().try_for_each(|stamp| rows.push(stamp, (), &mut take))?;
    let undecided = rows.finish(&mut take)?;
    let mut left_out = 0;
    for slice in file.slices(&(0..file.rows)) {
        let Some(chosen) = file.chosen(&slice, data)? else { break };
        for (instant, _) in instants[slice].iter_mut().zip(chosen).filter(|(_, chosen)| !chosen) {
            left_out += u64::from(*instant != NO_TIME);
            *instant = NO_TIME;
        }
    }
    Ok(Read { instants, undecided, left_out })
}
