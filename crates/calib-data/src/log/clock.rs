//! Determines how the files of a log write times and numbers, and converts times to instants.

use std::{
    collections::BTreeSet,
    ops::Range,
    path::{Path, PathBuf},
};

use calib_core::Monitor;
use calib_text::ParsedTime;

use super::{head::Head, rows::NO_TIME};
use crate::{
    DataConfig, DataError,
    text::{
        Candidates, Decimal, LocalTimes, Notation, Records, Signs, TextFile, Unreadable, Zone,
        shown,
    },
};

/// Years 1 to 9998, in microseconds. Databases use the year 9999 and the largest number for "never". Such a row is not
/// a row of the log.
const CALENDAR: Range<i64> = -62_135_596_800_000_000..253_370_764_800_000_000;

/// How the times of a file are read.
#[derive(Clone, Debug)]
pub(crate) struct Clock {
    pub(super) notation: Notation,
    zone: Option<Zone>,
}

impl Clock {
    pub(crate) fn new(notation: Notation, data: &DataConfig) -> Self {
        Self { notation, zone: data.time_zone.as_deref().and_then(Zone::new) }
    }

    pub(crate) fn has_zone(&self) -> bool {
        self.zone.is_some()
    }

    /// Creates a converter for successive rows of a file or of a tag.
    pub(crate) fn rows<Row>(&self) -> Instants<Row> {
        Instants { local: self.zone.clone().map(LocalTimes::new) }
    }
}

/// Converts the times of successive rows to instants.
#[derive(Debug)]
pub(crate) struct Instants<Row> {
    local: Option<LocalTimes<Row>>,
}

impl<Row> Instants<Row> {
    /// Adds the next row. `out` receives the rows in the same order, each with its instant, or [`NO_TIME`] for a
    /// missing time and for years outside the calendar. Rows of an hour that occurs twice follow as soon as their hour
    /// is known.
    pub(crate) fn push<E>(
        &mut self,
        stamp: Option<ParsedTime>,
        row: Row,
        out: &mut impl FnMut(Row, i64) -> Result<(), E>,
    ) -> Result<(), E> {
        let stamp = stamp.filter(|stamp| CALENDAR.contains(&stamp.as_it_stands()));
        match &mut self.local {
            Some(local) => local.push(stamp, row, out),
            None => out(row, stamp.map_or(NO_TIME, ParsedTime::as_it_stands)),
        }
    }

    /// Ends the rows. Returns the number of rows whose time names no instant, or two that no other row can tell apart.
    pub(crate) fn finish<E>(
        &mut self,
        out: &mut impl FnMut(Row, i64) -> Result<(), E>,
    ) -> Result<u64, E> {
        let Some(local) = &mut self.local else { return Ok(0) };
        local.finish(out)?;
        Ok(local.undecided)
    }
}

/// The notation of numbers in the text files of a log.
#[derive(Clone, Debug)]
pub(crate) struct Fractions {
    pub(crate) decimal: Decimal,
    /// The evidence for the sign, unless the study sets it. No cell of the log may contradict it.
    pub(crate) told_by: Option<Signs>,
    /// The warning for a sign that is likely but not certain.
    pub(crate) doubt: Option<String>,
}

impl Fractions {
    /// Determines the decimal sign from the first rows of all files.
    pub(crate) fn of(
        heads: &[Head],
        times: &[usize],
        data: &DataConfig,
    ) -> Result<Self, DataError> {
        let given =
            data.decimal.map(|sign| if sign == ',' { Decimal::Comma } else { Decimal::Point });
        if let Some(decimal) = given {
            return Ok(Self { decimal, told_by: None, doubt: None });
        }
        let mut signs = Signs::default();
        let mut have_semicolons = false;
        for (head, &time) in heads.iter().zip(times) {
            if let Head::Text(file) = head {
                signs.adopt(file.dialect.signs(time, &file.path));
                have_semicolons |= file.dialect.marks.separator == b';';
            }
        }
        let decimal = signs.decimal()?;
        let doubt = signs.doubt().filter(|_| have_semicolons);
        Ok(Self { decimal, told_by: Some(signs), doubt })
    }
}

/// The notations of times in all files.
#[derive(Debug, Default)]
pub(crate) struct Notations {
    /// The notation of each file.
    pub(crate) of_files: Vec<Notation>,
    /// Sentences about readings of times that are likely but not certain.
    pub(crate) doubts: BTreeSet<String>,
}

/// Returns the notation of the time column of each file. If one file is ambiguous, the others may decide.
pub(crate) fn notations(
    heads: &[Head],
    times: &[usize],
    data: &DataConfig,
    monitor: &dyn Monitor,
) -> Result<Notations, DataError> {
    if let Some(pattern) = &data.timestamp_format {
        let of_files = vec![Notation::Pattern(pattern.clone()); heads.len()];
        return Ok(Notations { of_files, doubts: BTreeSet::new() });
    }
    let mut candidates = Vec::with_capacity(heads.len());
    for (head, &time) in heads.iter().zip(times) {
        candidates.push(match head {
            Head::Text(file) => {
                Some(Candidates::of(&file.dialect.cells(time), data.timestamp_unit))
            }
            _ => None,
        });
    }
    let known = heads.iter().zip(&candidates).filter_map(|(head, found)| {
        let [notation] = &found.as_ref()?.left[..] else { return None };
        Some((notation, head.path()))
    });
    let told = each_once(known);
    refuse_two_orders(&told)?;
    let mut notations = Notations::default();
    for ((head, &time), found) in heads.iter().zip(times).zip(candidates) {
        let (Head::Text(file), Some(found)) = (head, found) else {
            notations.of_files.push(Notation::Iso);
            continue;
        };
        let notation = decided(file, time, found, &told, &mut notations.doubts, monitor)?;
        notations.of_files.push(notation);
    }
    let read = heads.iter().map(Head::path).zip(&notations.of_files);
    refuse_two_orders(&each_once(read.map(|(path, notation)| (notation, path))))?;
    Ok(notations)
}

/// A notation, and a file that uses it.
#[derive(Debug)]
struct Told {
    notation: Notation,
    path: PathBuf,
}

/// Returns the distinct notations, each with the first file that uses it.
fn each_once<'a>(all: impl Iterator<Item = (&'a Notation, &'a Path)>) -> Vec<Told> {
    let mut told: Vec<Told> = Vec::new();
    for (notation, path) in all {
        if told.iter().all(|told| told.notation != *notation) {
            told.push(Told { notation: notation.clone(), path: path.to_owned() });
        }
    }
    told
}

/// Rejects two files whose dates differ only in the order of day and month.
fn refuse_two_orders(told: &[Told]) -> Result<(), DataError> {
    for (at, first) in told.iter().enumerate() {
        let other = told[at + 1..].iter().find(|other| first.notation.swaps_days(&other.notation));
        if let Some(other) = other {
            return Err(DataError::Shape {
                reason: format!(
                    "{} has times as {} and {} as {}: the day and the month change places. Write them alike, or read one kind of files with data.path and data.timestamp_format",
                    first.path.display(),
                    first.notation.name(),
                    other.path.display(),
                    other.notation.name()
                ),
            });
        }
    }
    Ok(())
}

/// Returns the notation of the times of a file: by its first rows, the other files, all of its rows, or common
/// practice.
fn decided(
    file: &TextFile,
    time: usize,
    mut found: Candidates,
    told: &[Told],
    doubts: &mut BTreeSet<String>,
    monitor: &dyn Monitor,
) -> Result<Notation, DataError> {
    let cells = file.dialect.cells(time);
    if found.left.is_empty() {
        // If lines of one file are damaged, the notation of the other files counts.
        match told.iter().find(|told| reads_most(&told.notation, &cells)) {
            Some(told) => return Ok(told.notation.clone()),
            None => found = checked(found, file, time)?,
        }
    }
    if found.is_ambiguous() {
        let elsewhere: Vec<&Told> =
            told.iter().filter(|told| found.left.contains(&told.notation)).collect();
        if let [one] = elsewhere[..] {
            refuse_far_days(file, time, &found, one, monitor)?;
            return Ok(one.notation.clone());
        }
        let days = read_all_rows(file, time, &mut found, monitor)?;
        found = checked(found, file, time)?;
        if found.is_ambiguous() {
            let Some(likely) = found.likely(&cells, &days) else {
                return Err(DataError::AmbiguousTimes {
                    path: file.path.clone(),
                    example: found.example.clone(),
                    readings: found.readings(),
                });
            };
            doubts.insert(likely.told);
            return Ok(likely.notation);
        }
    }
    Ok(found.left.swap_remove(0))
}

/// Number of days that show the order of the fields of dates. Our choice.
const ENOUGH_DAYS: usize = 1_000;

/// Returns the part of a time before the time of day.
fn date_in(text: &str) -> &str {
    text.split([' ', 'T']).next().unwrap_or_default()
}

/// Minimum step, in microseconds, that counts as a sign of swapped day and month: 20 days. A swap turns one day into
/// months.
const FAR: i64 = 20 * 86_400_000_000;

/// Refuse the notation that another file told if it puts days of this file months apart that are near each other in another notation. A file without
/// two rows of a day, as of a laboratory, may have a row a month.
fn refuse_far_days(
    file: &TextFile,
    time: usize,
    found: &Candidates,
    told: &Told,
    monitor: &dyn Monitor,
) -> Result<(), DataError> {
    let mut far = vec![0_u64; found.left.len()];
    let mut last: Vec<Option<i64>> = vec![None; found.left.len()];
    let mut last_date = String::new();
    let mut is_dense = false;
    for_each_time(file, time, monitor, |text| {
        // Most rows are of the day of the row before them.
        let date = date_in(text);
        if date == last_date {
            is_dense = true;
        } else {
            date.clone_into(&mut last_date);
            for (at, notation) in found.left.iter().enumerate() {
                let Some(now) = notation.read(text).map(ParsedTime::as_it_stands) else { continue };
                let before = last[at].replace(now);
                far[at] +=
                    u64::from(before.is_some_and(|before| before.abs_diff(now) > FAR as u64));
            }
        }
        true
    })?;
    let mut counts = found.left.iter().zip(&far);
    let near = counts.clone().find(|(_, far)| **far == 0);
    let makes_gaps =
        is_dense && counts.any(|(notation, &far)| *notation == told.notation && far > 0);
    match near.filter(|_| makes_gaps) {
        None => Ok(()),
        Some((near, _)) => Err(DataError::Shape {
            reason: format!(
                "{} has times as {}, and with it days of {} are months apart, which are not as {}: if all files have one order, set data.timestamp_format to it; \
                 if the day and the month change places from file to file, write them alike, or read one kind of files with data.path and data.timestamp_format",
                told.path.display(),
                told.notation.name(),
                file.path.display(),
                near.name()
            ),
        }),
    }
}

fn reads_most(notation: &Notation, cells: &[&str]) -> bool {
    2 * cells.iter().filter(|cell| notation.read(cell).is_some()).count() > cells.len()
}

fn checked(found: Candidates, file: &TextFile, time: usize) -> Result<Candidates, DataError> {
    let reason = match &found.unreadable {
        Some(Unreadable::Cell(text)) if found.left.is_empty() => {
            let line = file.dialect.line_of(time, text);
            format!(
                "{}{} is in no notation that is known and that the others have; say how it is written with data.timestamp_format, such as \"%d.%m.%Y %H:%M:%S\"",
                line.map_or_else(String::new, |line| format!("line {line}: ")),
                shown(text)
            )
        }
        Some(Unreadable::Numbers(reason)) if found.left.is_empty() => reason.clone(),
        _ => return Ok(found),
    };
    let column = file.columns()[time].name.clone();
    Err(DataError::BadTimestamp { path: file.path.clone(), column, reason })
}

/// Moves to the next record and skips damaged lines.
fn advance(records: &mut Records<'_>) -> Result<bool, DataError> {
    loop {
        match records.advance() {
            Err(DataError::Record { .. }) => {}
            read => return read,
        }
    }
}

/// Calls `take` with the time of each row that has one, as text, until it returns false.
fn for_each_time(
    file: &TextFile,
    time: usize,
    monitor: &dyn Monitor,
    mut take: impl FnMut(&str) -> bool,
) -> Result<(), DataError> {
    let mut blocks = file.blocks()?;
    while let Some(block) = blocks.next(1)? {
        monitor.check()?;
        for (range, line) in &block.parts {
            let mut records = file.records(&block, range.clone(), *line);
            while advance(&mut records)? {
                let text = records.time(time);
                let text = text.trim();
                if !text.is_empty() && !take(text) {
                    return Ok(());
                }
            }
        }
    }
    Ok(())
}

/// Reads the times of all rows until one of them decides. Several notations remain in `found` if no row does. Returns
/// the times of the first rows whose date is not that of the row before.
fn read_all_rows(
    file: &TextFile,
    time: usize,
    found: &mut Candidates,
    monitor: &dyn Monitor,
) -> Result<Vec<String>, DataError> {
    let mut days: Vec<String> = Vec::new();
    // Any number can be read in every unit.
    let may_decide = found.left.iter().any(|notation| !matches!(notation, Notation::Number(_)));
    for_each_time(file, time, monitor, |text| {
        let has_enough = days.len() == ENOUGH_DAYS;
        if !has_enough && days.last().is_none_or(|last| date_in(last) != date_in(text)) {
            days.push(text.to_owned());
        }
        // What none of them can read is a damaged line, which is told later.
        if may_decide && found.left.iter().any(|notation| notation.read(text).is_some()) {
            found.note(text);
        }
        found.is_ambiguous() && (may_decide || days.len() < ENOUGH_DAYS)
    })?;
    Ok(days)
}
