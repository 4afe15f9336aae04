//! From what text says to instants.

use calib_text::ParsedTime;

use super::{head::Head, rows::NO_TIME, times::CALENDAR};
use crate::{
    DataConfig, DataError,
    text::{
        Candidates, Decimal, LocalTimes, Notation, Records, Signs, TextFile, Unreadable, Zone,
        shown,
    },
};

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

    /// For the rows of a file or of a tag, one after the other.
    pub(crate) fn rows<Row>(&self) -> Instants<Row> {
        Instants { local: self.zone.clone().map(LocalTimes::new) }
    }
}

/// Rows one after the other, and their instants.
#[derive(Debug)]
pub(crate) struct Instants<Row> {
    local: Option<LocalTimes<Row>>,
}

impl<Row> Instants<Row> {
    /// Take the next row. `out` gets rows in this order, each with its instant, or [`NO_TIME`] for none and for years that
    /// stand for something else; rows of an hour that comes twice as soon as it is known which of the two.
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

    /// Say that there are no more rows. Returns how many had a time that names no instant, or two between which nothing
    /// decides.
    pub(crate) fn finish<E>(
        &mut self,
        out: &mut impl FnMut(Row, i64) -> Result<(), E>,
    ) -> Result<u64, E> {
        let Some(local) = &mut self.local else { return Ok(0) };
        local.finish(out)?;
        Ok(local.undecided)
    }
}

/// How fractions are written in the text files of a log.
#[derive(Clone, Debug)]
pub(crate) struct Fractions {
    pub(crate) decimal: Decimal,
    /// What told, unless the study did: no cell of the log may contradict it.
    pub(crate) told_by: Option<Signs>,
}

impl Fractions {
    /// By the first rows of all files.
    pub(crate) fn of(
        heads: &[Head],
        times: &[usize],
        data: &DataConfig,
    ) -> Result<Self, DataError> {
        let given =
            data.decimal.map(|sign| if sign == ',' { Decimal::Comma } else { Decimal::Point });
        if let Some(decimal) = given {
            return Ok(Self { decimal, told_by: None });
        }
        let mut signs = Signs::default();
        for (head, &time) in heads.iter().zip(times) {
            if let Head::Text(file) = head {
                signs.adopt(file.dialect.signs(time, &file.path));
            }
        }
        Ok(Self { decimal: signs.decimal()?, told_by: Some(signs) })
    }
}

/// The notation of the time column of each file, by all files: what one leaves open another may tell.
pub(crate) fn notations(
    heads: &[Head],
    times: &[usize],
    data: &DataConfig,
) -> Result<Vec<Notation>, DataError> {
    if let Some(pattern) = &data.timestamp_format {
        return Ok(vec![Notation::Pattern(pattern.clone()); heads.len()]);
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
    let mut told: Vec<Notation> = Vec::new();
    for found in candidates.iter().flatten().filter(|found| !found.is_ambiguous()) {
        told.extend(
            found.left.iter().filter(|left| !told.contains(left)).cloned().collect::<Vec<_>>(),
        );
    }
    heads
        .iter()
        .zip(times)
        .zip(candidates)
        .map(|((head, &time), found)| {
            let (Head::Text(file), Some(mut found)) = (head, found) else {
                return Ok(Notation::Iso);
            };
            if found.left.is_empty() {
                // Damaged lines of one file are told by how the others write times.
                let cells = file.dialect.cells(time);
                match told.iter().find(|notation| reads_most(notation, &cells)) {
                    Some(notation) => return Ok(notation.clone()),
                    None => found = checked(found, file, time)?,
                }
            }
            if found.is_ambiguous() {
                let mut elsewhere = found.left.iter().filter(|left| told.contains(left));
                match (elsewhere.next().cloned(), elsewhere.next()) {
                    (Some(notation), None) => found.left = vec![notation],
                    _ => found = by_all_rows(file, time, found)?,
                }
            }
            Ok(found.left.swap_remove(0))
        })
        .collect()
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

/// Go to the next record, past lines that are none.
fn advance(records: &mut Records<'_>) -> Result<bool, DataError> {
    loop {
        match records.advance() {
            Err(DataError::Record { .. }) => {}
            read => return read,
        }
    }
}

/// Read the times of all rows until one of them tells.
fn by_all_rows(
    file: &TextFile,
    time: usize,
    mut found: Candidates,
) -> Result<Candidates, DataError> {
    // Any number can be read in every unit.
    let mut blocks = if found.left.iter().all(|notation| matches!(notation, Notation::Number(_))) {
        None
    } else {
        Some(file.blocks()?)
    };
    while let Some(block) = blocks.as_mut().map(|blocks| blocks.next(1)).transpose()?.flatten() {
        for (range, line) in &block.parts {
            let mut records = file.records(&block.bytes[range.clone()], *line);
            while advance(&mut records)? {
                let text = records.time(time);
                // What none of them can read is a damaged line, which is told later.
                if !text.trim().is_empty()
                    && found.left.iter().any(|notation| notation.read(text.trim()).is_some())
                {
                    found.note(text.trim());
                }
                if !found.is_ambiguous() {
                    return checked(found, file, time);
                }
            }
        }
    }
    Err(DataError::AmbiguousTimes {
        path: file.path.clone(),
        example: found.example.clone(),
        readings: found.readings(),
    })
}
