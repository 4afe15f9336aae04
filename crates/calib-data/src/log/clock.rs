//! From what text says to instants.

use super::{head::Head, rows::NO_TIME, times::CALENDAR};
use crate::{
    DataConfig, DataError,
    text::{Candidates, Notation, TextFile, Zone},
    time::Stamp,
};

/// How the times of a file are read, one after the other.
#[derive(Clone, Debug)]
pub(crate) struct Clock {
    notation: Notation,
    zone: Option<Zone>,
}

impl Clock {
    pub(crate) fn new(notation: Notation, data: &DataConfig) -> Self {
        Self { notation, zone: data.time_zone.as_deref().and_then(Zone::new) }
    }

    pub(crate) fn notation(&self) -> &Notation {
        &self.notation
    }

    pub(crate) fn has_zone(&self) -> bool {
        self.zone.is_some()
    }

    /// The instant that a time is, [`NO_TIME`] for none and for years that stand for something else.
    pub(crate) fn instant(&mut self, stamp: Option<Stamp>) -> i64 {
        let micros = match (stamp, &mut self.zone) {
            (None, _) => return NO_TIME,
            (Some(Stamp::Wall(wall)), Some(zone)) => zone.instant(wall),
            (Some(stamp), _) => stamp.as_it_stands(),
        };
        if CALENDAR.contains(&micros) { micros } else { NO_TIME }
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
        let Head::Text(file) = head else {
            candidates.push(None);
            continue;
        };
        let found = Candidates::of(&file.dialect.cells(time), data.timestamp_unit);
        candidates.push(Some(checked(found, file, time)?));
    }
    let told: Vec<Notation> = candidates
        .iter()
        .flatten()
        .filter(|found| !found.is_ambiguous())
        .flat_map(|found| found.left.clone())
        .collect();
    heads
        .iter()
        .zip(times)
        .zip(candidates)
        .map(|((head, &time), found)| {
            let (Head::Text(file), Some(mut found)) = (head, found) else {
                return Ok(Notation::Iso);
            };
            if found.is_ambiguous() {
                let elsewhere = found.left.iter().find(|left| told.contains(left)).cloned();
                match elsewhere {
                    Some(notation) => found.left = vec![notation],
                    None => found = by_all_rows(file, time, found)?,
                }
            }
            Ok(found.left.swap_remove(0))
        })
        .collect()
}

fn checked(found: Candidates, file: &TextFile, time: usize) -> Result<Candidates, DataError> {
    match &found.unreadable {
        Some(text) if found.left.is_empty() => Err(DataError::BadTimestamp {
            path: file.path.clone(),
            column: file.columns()[time].name.clone(),
            reason: format!(
                "{text:?} is in no notation that is known and that the others have; say how it is written with data.timestamp_format, such as \"%d.%m.%Y %H:%M:%S\""
            ),
        }),
        _ => Ok(found),
    }
}

/// Read the times of all rows until one of them tells.
fn by_all_rows(
    file: &TextFile,
    time: usize,
    mut found: Candidates,
) -> Result<Candidates, DataError> {
    let mut blocks = file.blocks()?;
    while let Some(block) = blocks.next(1)? {
        for (range, line) in &block.parts {
            let mut records = file.records(&block.bytes[range.clone()], *line);
            while records.advance()? {
                let text = records.text(time);
                if !text.trim().is_empty() {
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
