//! Streams files of samples into their tags.

use std::collections::{BTreeMap, HashMap};

use calib_core::Monitor;
use calib_text::ParsedTime;
use polars::prelude as pl;

use super::{
    clock::{Clock, Fractions, Instants},
    columns::{cell, next_row, stamp},
    file::LogFile,
    head::Head,
    series::Sink,
    shape::{Roles, TagOf},
    side_labels::SideLabels,
    store::Seen,
    times::Times,
    values::{RawColumn, each_label, to_cells},
};
use crate::{
    DataConfig, DataError,
    text::{
        Annotated, Cell, Decimal, Key, Notation, Quality, Records, TextFile, Words, annotated_names,
    },
};

/// Samples that one thread read, with its own lists of tags and words.
#[derive(Default)]
struct LongChunk {
    tags: Vec<u32>,
    stamps: Vec<Option<ParsedTime>>,
    cells: Vec<u64>,
    /// The names that `tags` are positions of.
    names: Words,
    /// Labels in each column of `Roles::sides` beside each tag, `[tags][columns]`.
    sides: Vec<SideLabels>,
    seen: Seen,
    bad_quality: u64,
}

/// Writes samples of a file to their tags. For each tag separately, it resolves the hour that occurs twice.
struct SampleWriter<'a> {
    clock: &'a Clock,
    sink: &'a mut Sink,
    instants: BTreeMap<usize, Instants<u64>>,
}

impl<'a> SampleWriter<'a> {
    fn new(clock: &'a Clock, sink: &'a mut Sink) -> Self {
        Self { clock, sink, instants: BTreeMap::new() }
    }

    fn push(&mut self, tag: usize, stamp: Option<ParsedTime>, cell: u64) -> Result<(), DataError> {
        let Self { clock, sink, instants } = self;
        if clock.has_zone() {
            let rows = instants.entry(tag).or_insert_with(|| clock.rows());
            rows.push(stamp, cell, &mut |cell, time| sink.push(tag, time, cell))
        } else {
            clock.rows().push(stamp, cell, &mut |cell, time| sink.push(tag, time, cell))
        }
    }

    fn finish(self) -> Result<(), DataError> {
        let Self { sink, instants, .. } = self;
        for (tag, mut instants) in instants {
            let undecided = instants.finish(&mut |cell, time| sink.push(tag, time, cell))?;
            sink.undecided += undecided;
        }
        Ok(())
    }
}

/// Reads all samples of a text file.
pub(crate) fn stream_text(
    file: &TextFile,
    roles: &Roles,
    clock: &Clock,
    fractions: &Fractions,
    sink: &mut Sink,
    monitor: &dyn Monitor,
) -> Result<(), DataError> {
    let mut writer = SampleWriter::new(clock, sink);
    file.read_parts(
        |records| LongChunk::read(records, roles, &clock.notation, fractions),
        |part| part.write_to(roles, &mut writer),
        monitor,
    )?;
    writer.finish()
}

impl LongChunk {
    fn read(
        mut records: Records<'_>,
        roles: &Roles,
        notation: &Notation,
        fractions: &Fractions,
    ) -> Result<Self, DataError> {
        let mut part = Self::default();
        // Most rows repeat the tag or the time of the row before them.
        let (mut last_tag, mut last_time): (Vec<u8>, Vec<u8>) = Default::default();
        if let TagOf::File(name) = &roles.tag {
            part.names.position(name);
        }
        // Each tag of a long table may have its own number of decimals.
        let decimal = match roles.tag {
            TagOf::File(_) => fractions.decimal,
            TagOf::Column(_) => Decimal::Unknown,
        };
        let mut bad_rows = std::mem::take(&mut part.seen.bad_rows);
        while let Some(time) = next_row(&mut records, decimal, &mut bad_rows, |records| {
            let bytes = records.bytes(roles.time);
            match part.stamps.last() {
                Some(&last) if !records.has_time_parts() && bytes == last_time => Ok(last),
                _ => {
                    let read = stamp(records, roles.time, notation)?;
                    last_time = bytes.to_vec();
                    Ok(read)
                }
            }
        })? {
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
            let cell = part.value(&records, roles, fractions)?;
            for (side, column) in roles.sides.iter().enumerate() {
                let labels = part.side(tag, side, roles.sides.len());
                if !labels.knows(records.bytes(column.position)) {
                    labels.add(&records.text(column.position));
                }
            }
            part.tags.push(tag);
            part.stamps.push(time);
            part.cells.push(cell.encode());
        }
        part.seen.bad_rows = bad_rows;
        Ok(part)
    }

    fn value(
        &mut self,
        records: &Records<'_>,
        roles: &Roles,
        fractions: &Fractions,
    ) -> Result<Cell, DataError> {
        if let Some((column, quality)) = &roles.quality {
            let code = records.text(*column);
            if !quality.is_good(&code).map_err(|reason| records.refused(reason))? {
                self.bad_quality += 1;
                return Ok(Cell::Missing);
            }
        }
        for &column in &roles.values {
            match cell(records, column, fractions, &mut self.seen)? {
                Cell::Missing => {}
                cell => return Ok(cell),
            }
        }
        Ok(Cell::Missing)
    }

    /// Returns the labels of column `side` of `sides` beside a tag.
    fn side(&mut self, tag: u32, side: usize, sides: usize) -> &mut SideLabels {
        let place = tag as usize * sides + side;
        if self.sides.len() <= place {
            self.sides.resize_with(place + 1, SideLabels::default);
        }
        &mut self.sides[place]
    }

    /// Removes the values of bad `quality`, by the codes in `column` of a Parquet file.
    fn leave_out_bad(
        &mut self,
        column: &RawColumn,
        quality: &Quality,
        file: &LogFile,
    ) -> Result<(), DataError> {
        let mut known: HashMap<String, bool> = HashMap::new();
        let mut is_good = Vec::with_capacity(self.cells.len());
        let mut unknown = None;
        each_label(column, |code| {
            let code = code.unwrap_or_default();
            let good = known.get(code).copied().unwrap_or_else(|| {
                let good = quality.is_good(code).unwrap_or_else(|reason| {
                    unknown.get_or_insert(reason);
                    false
                });
                known.insert(code.to_owned(), good);
                good
            });
            is_good.push(good);
        })
        .map_err(|error| file.damaged(&error))?;
        if let Some(reason) = unknown {
            let reason = format!("{}: {reason}", file.path().display());
            return Err(DataError::Shape { reason });
        }
        for (cell, _) in self.cells.iter_mut().zip(is_good).filter(|(_, good)| !good) {
            self.bad_quality += 1;
            *cell = Cell::Missing.encode();
        }
        Ok(())
    }

    /// Records the labels in the last of `columns` of a Parquet file, those of `Roles::sides`, beside the chosen
    /// samples.
    fn add_sides(
        &mut self,
        columns: &[RawColumn],
        chosen: Option<&[bool]>,
        roles: &Roles,
    ) -> pl::PolarsResult<()> {
        let tags = std::mem::take(&mut self.tags);
        for (side, column) in columns[columns.len() - roles.sides.len()..].iter().enumerate() {
            let mut row = 0;
            each_label(column, |word| {
                let is_chosen = chosen.is_none_or(|chosen| chosen[row]);
                if let Some(word) = word.filter(|_| is_chosen) {
                    let labels = self.side(tags[row], side, roles.sides.len());
                    if !labels.knows(word.as_bytes()) {
                        labels.add(word);
                    }
                }
                row += 1;
            })?;
        }
        self.tags = tags;
        Ok(())
    }

    /// Removes the samples that are not chosen.
    fn keep(&mut self, chosen: Option<&[bool]>) {
        let Some(chosen) = chosen else { return };
        let mut flags = chosen.iter();
        self.tags.retain(|_| flags.next().is_some_and(|is| *is));
        let mut flags = chosen.iter();
        self.stamps.retain(|_| flags.next().is_some_and(|is| *is));
        let mut flags = chosen.iter();
        self.cells.retain(|_| flags.next().is_some_and(|is| *is));
    }

    fn write_to(mut self, roles: &Roles, writer: &mut SampleWriter<'_>) -> Result<(), DataError> {
        let tags = self.names.all().map(|name| writer.sink.tag(name));
        let tags: Vec<usize> = tags.collect::<Result<_, _>>()?;
        for (place, labels) in self.sides.iter().enumerate() {
            let (tag, side) = (place / roles.sides.len(), place % roles.sides.len());
            writer.sink.add_side(tags[tag], &roles.sides[side].name, labels);
        }
        writer.sink.store.adopt(self.seen, &mut self.cells)?;
        writer.sink.bad_quality += self.bad_quality;
        for ((tag, stamp), cell) in self.tags.into_iter().zip(self.stamps).zip(self.cells) {
            writer.push(tags[tag as usize], stamp, cell)?;
        }
        Ok(())
    }
}

/// Reads all samples of a Parquet file.
pub(crate) fn stream_parquet(
    file: &LogFile,
    roles: &Roles,
    clock: &Clock,
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
    let tag_column = fields.len() - 1;
    fields.extend(roles.sides.iter().map(|side| side.position));
    let mut unit = data.timestamp_unit;
    let mut writer = SampleWriter::new(clock, sink);
    for slice in file.slices(&(0..file.rows)) {
        monitor.check()?;
        let columns = file.read(&fields, &slice)?;
        let mut part = LongChunk::default();
        let times = Times::of(&columns[0], file, data, slice.start)?;
        part.stamps = times.stamps(&mut unit, file, roles.time)?;
        part.cells = vec![Cell::Missing.encode(); slice.len()];
        for column in columns[1..=roles.values.len()].iter().rev() {
            let cells =
                to_cells(column, &mut part.seen.words).map_err(|error| file.damaged(&error))?;
            for (out, cell) in part.cells.iter_mut().zip(cells) {
                if Cell::decode(cell) != Cell::Missing {
                    *out = cell;
                }
            }
        }
        if let Some((_, quality)) = &roles.quality {
            part.leave_out_bad(&columns[1 + roles.values.len()], quality, file)?;
        }
        let chosen = file.chosen(&slice, data)?;
        part.tags = match &roles.tag {
            TagOf::File(name) => vec![part.names.position(name); slice.len()],
            TagOf::Column(_) => {
                let mut tags = Vec::with_capacity(slice.len());
                let names = &mut part.names;
                each_label(&columns[tag_column], |tag| {
                    tags.push(names.position(tag.unwrap_or_default()));
                })
                .map_err(|error| file.damaged(&error))?;
                tags
            }
        };
        part.add_sides(&columns, chosen.as_deref(), roles).map_err(|error| file.damaged(&error))?;
        part.keep(chosen.as_deref());
        part.write_to(roles, &mut writer)?;
    }
    writer.finish()
}

/// Reads annotated files. Their tags are named when all are known.
pub(crate) fn stream_annotated(
    heads: &[Head],
    clock: &Clock,
    sink: &mut Sink,
    monitor: &dyn Monitor,
) -> Result<(), DataError> {
    let mut known: HashMap<Key, usize> = HashMap::new();
    let mut words = Words::bounded();
    for head in heads {
        let mut writer = SampleWriter::new(clock, sink);
        Annotated::open(head.path())?.read(
            &mut words,
            |sample, words| {
                let tag = if let Some(&tag) = known.get(sample.key) {
                    tag
                } else {
                    let tag = writer.sink.add_tag()?;
                    known.insert(sample.key.clone(), tag);
                    tag
                };
                let cell = match sample.cell {
                    Cell::Word(word) => Cell::Word(writer.sink.store.words.translated(words, word)),
                    cell => cell,
                };
                writer.push(tag, sample.time, cell.encode())
            },
            monitor,
        )?;
        writer.finish()?;
        monitor.advance(1);
    }
    let mut keys = vec![Key::default(); known.len()];
    for (key, tag) in known {
        keys[tag] = key;
    }
    sink.rename(annotated_names(&keys));
    Ok(())
}
