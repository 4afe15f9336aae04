//! Files of samples, streamed into their tags.

use std::collections::HashMap;

use calib_core::Monitor;

use super::{
    clock::Clock,
    columns::{cell, stamp},
    file::LogFile,
    head::Head,
    series::Sink,
    shape::{Roles, TagOf},
    times::Times,
    values::to_cells,
};
use crate::{
    DataConfig, DataError,
    text::{Annotated, Cell, Decimal, Notation, Records, TextFile, Words, annotated_names},
    time::Stamp,
};

/// Samples that one thread read, with names of its own for tags and words.
#[derive(Default)]
struct Part {
    tags: Vec<u32>,
    stamps: Vec<Option<Stamp>>,
    cells: Vec<u64>,
    names: Names,
    words: Words,
    bad_quality: u64,
}

/// Names of tags, each once.
#[derive(Default)]
struct Names {
    list: Vec<String>,
    positions: HashMap<String, u32>,
}

impl Names {
    fn position(&mut self, name: &str) -> u32 {
        if let Some(&position) = self.positions.get(name) {
            return position;
        }
        let position = self.list.len() as u32;
        self.list.push(name.to_owned());
        self.positions.insert(name.to_owned(), position);
        position
    }
}

/// Read all samples of a file.
pub(crate) fn stream(
    head: &Head,
    roles: &Roles,
    clock: Clock,
    data: &DataConfig,
    sink: &mut Sink,
    monitor: &dyn Monitor,
) -> Result<(), DataError> {
    match head {
        Head::Text(file) => stream_text(file, roles, clock, sink, monitor),
        Head::Parquet(file) => stream_parquet(file, roles, clock, data, sink, monitor),
        Head::Annotated(..) => Ok(()),
    }
}

fn stream_text(
    file: &TextFile,
    roles: &Roles,
    mut clock: Clock,
    sink: &mut Sink,
    monitor: &dyn Monitor,
) -> Result<(), DataError> {
    let decimal = file.decimal(roles.time)?;
    let notation = clock.notation().clone();
    let mut clocks = HashMap::new();
    let read = |records: Records<'_>| Part::read(records, roles, &notation, decimal);
    file.read_parts(read, |part| part.pour(&mut clock, &mut clocks, sink), monitor)
}

impl Part {
    fn read(
        mut records: Records<'_>,
        roles: &Roles,
        notation: &Notation,
        decimal: Decimal,
    ) -> Result<Self, DataError> {
        let mut part = Self::default();
        // Most rows repeat the tag or the time of the row before them.
        let (mut last_tag, mut last_time): (Vec<u8>, Vec<u8>) = Default::default();
        if let TagOf::File(name) = &roles.tag {
            part.names.position(name);
        }
        while records.advance()? {
            let tag = match roles.tag {
                TagOf::File(_) => 0,
                TagOf::Column(column) => {
                    let bytes = records.bytes(column);
                    match part.tags.last() {
                        Some(&last) if bytes == last_tag => last,
                        _ => {
                            last_tag = bytes.to_vec();
                            let text = records.text(column);
                            part.names.position(text.trim())
                        }
                    }
                }
            };
            let bytes = records.bytes(roles.time);
            let time = match part.stamps.last() {
                Some(&last) if bytes == last_time => last,
                _ => {
                    last_time = bytes.to_vec();
                    stamp(&records, roles.time, notation)?
                }
            };
            let cell = part.value(&records, roles, decimal)?;
            part.tags.push(tag);
            part.stamps.push(time);
            part.cells.push(cell.encode());
        }
        Ok(part)
    }

    fn value(
        &mut self,
        records: &Records<'_>,
        roles: &Roles,
        decimal: Decimal,
    ) -> Result<Cell, DataError> {
        if let Some((column, quality)) = &roles.quality {
            let code = records.text(*column);
            if !quality.is_good(&code).map_err(|reason| records.refused(reason))? {
                self.bad_quality += 1;
                return Ok(Cell::Missing);
            }
        }
        for &column in &roles.values {
            match cell(records, column, decimal, &mut self.words)? {
                Cell::Missing => {}
                cell => return Ok(cell),
            }
        }
        Ok(Cell::Missing)
    }

    fn pour(
        mut self,
        clock: &mut Clock,
        clocks: &mut HashMap<usize, Clock>,
        sink: &mut Sink,
    ) -> Result<(), DataError> {
        let tags: Vec<usize> = self.names.list.iter().map(|name| sink.tag(name)).collect();
        sink.store.words.adopt(&self.words, &mut self.cells);
        sink.bad_quality += self.bad_quality;
        for ((tag, stamp), cell) in self.tags.into_iter().zip(self.stamps).zip(self.cells) {
            let tag = tags[tag as usize];
            let time = if clock.has_zone() {
                // Each tag goes through the hour that comes twice by itself.
                clocks.entry(tag).or_insert_with(|| clock.clone()).instant(stamp)
            } else {
                clock.instant(stamp)
            };
            sink.push(tag, time, cell)?;
        }
        Ok(())
    }
}

fn stream_parquet(
    file: &LogFile,
    roles: &Roles,
    mut clock: Clock,
    data: &DataConfig,
    sink: &mut Sink,
    monitor: &dyn Monitor,
) -> Result<(), DataError> {
    let mut fields = vec![roles.time];
    fields.extend(&roles.values);
    fields.extend(roles.quality.iter().map(|(column, _)| *column));
    fields.extend(match roles.tag {
        TagOf::Column(column) => Some(column),
        TagOf::File(_) => None,
    });
    let mut unit = data.timestamp_unit;
    let mut clocks = HashMap::new();
    for slice in file.slices(&(0..file.rows)) {
        if monitor.interrupted() {
            return Err(DataError::Interrupted);
        }
        let columns = file.read(&fields, &slice)?;
        let mut part = Part::default();
        let times = Times::of(&columns[0], file, data, slice.start)?;
        part.stamps = times.stamps(&mut unit);
        part.cells = vec![Cell::Missing.encode(); slice.len()];
        for column in columns[1..=roles.values.len()].iter().rev() {
            let cells = to_cells(column, &mut part.words).map_err(|error| file.damaged(&error))?;
            for (out, cell) in part.cells.iter_mut().zip(cells) {
                if Cell::decode(cell) != Cell::Missing {
                    *out = cell;
                }
            }
        }
        if let Some((_, quality)) = &roles.quality {
            let codes = super::values::to_labels(&columns[1 + roles.values.len()])
                .map_err(|error| file.damaged(&error))?;
            let mut known: HashMap<String, bool> = HashMap::new();
            for (cell, code) in part.cells.iter_mut().zip(codes) {
                let code = code.unwrap_or_default();
                let is_good = if let Some(&is_good) = known.get(&code) {
                    is_good
                } else {
                    let is_good = quality.is_good(&code).map_err(|reason| DataError::Shape {
                        reason: format!("{}: {reason}", file.path().display()),
                    })?;
                    known.insert(code, is_good);
                    is_good
                };
                if !is_good {
                    part.bad_quality += 1;
                    *cell = Cell::Missing.encode();
                }
            }
        }
        part.tags = match &roles.tag {
            TagOf::File(name) => vec![part.names.position(name); slice.len()],
            TagOf::Column(_) => {
                let labels = super::values::to_labels(&columns[fields.len() - 1])
                    .map_err(|error| file.damaged(&error))?;
                let names = &mut part.names;
                labels
                    .into_iter()
                    .map(|label| names.position(label.as_deref().unwrap_or("")))
                    .collect()
            }
        };
        part.pour(&mut clock, &mut clocks, sink)?;
    }
    Ok(())
}

/// Read annotated files, whose tags are named when all are known.
pub(crate) fn stream_annotated(
    heads: &[Head],
    clock: &Clock,
    sink: &mut Sink,
    monitor: &dyn Monitor,
) -> Result<(), DataError> {
    let mut keys = Vec::new();
    for head in heads {
        let mut words = Words::default();
        let mut known: HashMap<crate::text::Key, usize> = HashMap::new();
        let mut clock = clock.clone();
        Annotated::open(head.path())?.read(&mut words, |sample, words| {
            let tag = if let Some(&tag) = known.get(sample.key) {
                tag
            } else {
                let tag = sink.tag(&format!("{:?}", sample.key));
                if tag == keys.len() {
                    keys.push(sample.key.clone());
                }
                known.insert(sample.key.clone(), tag);
                tag
            };
            let mut cells = [sample.cell.encode()];
            if let Cell::Word(word) = sample.cell {
                cells =
                    [Cell::Word(sink.store.words.position(&words.list()[word as usize])).encode()];
            }
            sink.push(tag, clock.instant(sample.time), cells[0])
        })?;
        monitor.advance(1);
    }
    sink.rename(annotated_names(&keys));
    Ok(())
}
