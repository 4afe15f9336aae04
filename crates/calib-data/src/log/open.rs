//! From files to a log: what they are, their rows in time order, the ranges.

use std::{collections::HashMap, sync::Arc};

use calib_core::{Monitor, Period};

use super::{
    Channel, FileSummary, Log, Origin,
    clock::{Clock, notations},
    columns::{Imported, Store, Stored, import},
    file::{Field, FieldKind, LogFile},
    gaps,
    head::Head,
    long::{stream, stream_annotated},
    resample::Grid,
    row_ranges,
    rows::{Irregularities, NO_TIME, Rows},
    series::Sink,
    shape::{Recognised, Roles, recognise, time_column},
    source::{self, Source},
    split::{self, Split},
    times,
};
use crate::{
    DataConfig, DataError, Description, Shape,
    text::Notation,
    time::{Stamp, format_time},
};

/// What the files hold, before rows and ranges are known.
pub(super) enum Opened {
    /// Wide files, the position of the timestamp in each, and its values.
    Tables(Vec<LogFile>, Vec<usize>, Vec<Vec<i64>>),
    Samples(Shape, Vec<FileSummary>, Sink),
}

/// Find, open and recognise the files of a log; and whether its times are UTC.
pub(super) fn open(data: &DataConfig, monitor: &dyn Monitor) -> Result<(Opened, bool), DataError> {
    let sources = source::find_files(data)?;
    monitor.begin("reading timestamps", sources.len() as u64);
    let mut heads = Vec::with_capacity(sources.len());
    for source in &sources {
        if monitor.interrupted() {
            return Err(DataError::Interrupted);
        }
        let head = Head::open(source.clone(), data)?;
        match &head {
            Head::Parquet(file) if file.is_result => {}
            _ => heads.push(head),
        }
    }
    if heads.is_empty() {
        return Err(DataError::NoFile {
            pattern: data.path.0.join(", "),
            reason: "the only Parquet files there are results of calib, which are no logs"
                .to_owned(),
        });
    }
    let time = |head: &Head| match head {
        Head::Annotated(..) => Ok(0),
        _ => {
            time_column(head, &head.columns(), data).ok_or_else(|| times::no_timestamp(head, data))
        }
    };
    let times: Vec<usize> = heads.iter().map(time).collect::<Result<_, _>>()?;
    let recognised = recognise(&heads, &times, data)?;
    let notations = match recognised {
        Recognised::Annotated => Vec::new(),
        _ => notations(&heads, &times, data)?,
    };
    let utc = data.time_zone.is_some() || is_utc(&heads, &times, &notations)?;
    let opened = match recognised {
        Recognised::Wide => tables(heads, times, notations, data, monitor),
        Recognised::Samples(shape, roles) => {
            refuse_several_plants(&sources)?;
            samples(shape, &heads, &roles, notations, data, monitor)
        }
        Recognised::Annotated => {
            let mut sink = Sink::new(Store::new(&data.scratch)?);
            let clock = Clock::new(Notation::Iso, data);
            stream_annotated(&heads, &clock, &mut sink, monitor)?;
            let files = heads.iter().map(|head| summary(head, 0)).collect();
            Ok(Opened::Samples(Shape::Long, files, sink))
        }
    };
    Ok((opened?, utc))
}

/// Whether the files say which instants their times are, by an offset, a zone, or as numbers since 1970.
fn is_utc(heads: &[Head], times: &[usize], notations: &[Notation]) -> Result<bool, DataError> {
    let mut all = true;
    for (position, (head, &time)) in heads.iter().zip(times).enumerate() {
        all &= match head {
            Head::Annotated(..) => true,
            Head::Parquet(file) => {
                let field = &file.fields[time];
                field.kind == FieldKind::Number || field.type_name.starts_with("datetime in")
            }
            Head::Text(_) => {
                let sample = head.sample(time)?;
                let stamp = sample.first().and_then(|text| notations[position].read(text));
                matches!(stamp, Some(Stamp::Instant(_)))
            }
        };
    }
    Ok(all)
}

fn tables(
    heads: Vec<Head>,
    times: Vec<usize>,
    notations: Vec<Notation>,
    data: &DataConfig,
    monitor: &dyn Monitor,
) -> Result<Opened, DataError> {
    let mut store = Store::new(&data.scratch)?;
    let mut imported: HashMap<usize, Imported> = HashMap::new();
    for (position, (head, notation)) in heads.iter().zip(notations).enumerate() {
        if let Head::Text(file) = head {
            let mut clock = Clock::new(notation, data);
            let read = import(file, times[position], &mut clock, &mut store, monitor)?;
            imported.insert(position, read);
        }
    }
    let store = Arc::new(store);
    let mut files = Vec::with_capacity(heads.len());
    for (position, head) in heads.into_iter().enumerate() {
        files.push(match (head, imported.remove(&position)) {
            (Head::Text(file), Some(read)) => {
                let source =
                    Source { path: file.path.clone(), partitions: source::partitions(&file.path) };
                let columns = file.columns().iter().zip(&read.words_only);
                let field = |(column, &words_only): (&crate::text::TextColumn, &bool)| {
                    let (kind, type_name) = if words_only {
                        (FieldKind::Text, "text")
                    } else {
                        (FieldKind::Number, "number")
                    };
                    Field {
                        name: column.name.clone(),
                        kind,
                        type_name: type_name.to_owned(),
                        description: Description {
                            unit: column.unit.clone(),
                            label: column.label.clone(),
                        },
                    }
                };
                let fields = columns.map(field).collect();
                let stored =
                    Stored { columns: read.columns, times: read.times, store: Arc::clone(&store) };
                LogFile::stored(source, fields, file.bytes, stored)
            }
            (Head::Parquet(file), _) => *file,
            (Head::Text(_) | Head::Annotated(..), _) => continue,
        });
    }
    let mut instants = Vec::with_capacity(files.len());
    for (file, &time) in files.iter().zip(&times) {
        if monitor.interrupted() {
            return Err(DataError::Interrupted);
        }
        instants.push(times::read_timestamps(file, time, data)?);
        monitor.advance(1);
    }
    Ok(Opened::Tables(files, times, instants))
}

fn samples(
    shape: Shape,
    heads: &[Head],
    roles: &[Roles],
    notations: Vec<Notation>,
    data: &DataConfig,
    monitor: &dyn Monitor,
) -> Result<Opened, DataError> {
    let mut sink = Sink::new(Store::new(&data.scratch)?);
    let mut files = Vec::with_capacity(heads.len());
    for ((head, roles), notation) in heads.iter().zip(roles).zip(notations) {
        let before = sink.rows;
        stream(head, roles, Clock::new(notation, data), data, &mut sink, monitor)?;
        files.push(summary(head, (sink.rows - before) as usize));
        monitor.advance(1);
    }
    Ok(Opened::Samples(shape, files, sink))
}

fn summary(head: &Head, rows: usize) -> FileSummary {
    let bytes = match head {
        Head::Parquet(file) => file.bytes,
        Head::Text(file) => file.bytes,
        Head::Annotated(_, bytes) => *bytes,
    };
    FileSummary { path: head.path().to_owned(), bytes, rows }
}

/// What rows there are, before they are cut into ranges.
struct Planned {
    origin: Origin,
    files: Vec<FileSummary>,
    shape: Shape,
    channels: Vec<Channel>,
    rows: Rows,
    split: Split,
    /// The first and the last instant of all.
    span: (i64, i64),
    bad_quality: u64,
}

impl Opened {
    pub(super) fn into_log(self, utc: bool, data: &DataConfig) -> Result<Log, DataError> {
        let planned = match self {
            Self::Tables(files, times, instants) => plan_tables(files, &times, &instants, data)?,
            Self::Samples(shape, files, sink) => plan_samples(shape, files, sink, data)?,
        };
        Ok(Log { utc, ..planned.into_log(data)? })
    }
}

fn plan_tables(
    files: Vec<LogFile>,
    times: &[usize],
    instants: &[Vec<i64>],
    data: &DataConfig,
) -> Result<Planned, DataError> {
    let total: usize = instants.iter().map(Vec::len).sum();
    if u32::try_from(total).is_err() {
        return Err(DataError::TooManyRows { rows: total as u64 });
    }
    let present = || instants.iter().flatten().copied().filter(|&time| time != NO_TIME);
    let (Some(first), Some(last)) = (present().min(), present().max()) else {
        return Err(DataError::NoRows { path: data.path.0.join(", "), files: files.len() });
    };
    let split = Split::new(data, first, last)?;
    let rows = Rows::plan(instants, &split.window());
    refuse_mixed_partitions(&files, &rows.irregularities)?;
    Ok(Planned {
        channels: list_channels(&files, times),
        files: files
            .iter()
            .map(|file| FileSummary {
                path: file.path().to_owned(),
                bytes: file.bytes,
                rows: file.rows,
            })
            .collect(),
        origin: Origin::Tables(files),
        shape: Shape::Wide,
        rows,
        split,
        span: (first, last),
        bad_quality: 0,
    })
}

fn plan_samples(
    shape: Shape,
    files: Vec<FileSummary>,
    sink: Sink,
    data: &DataConfig,
) -> Result<Planned, DataError> {
    let (null_timestamps, bad_quality) = (sink.null_times, sink.bad_quality);
    let series = sink.finish()?;
    let Some((first, last)) = series.span() else {
        return Err(DataError::NoRows { path: data.path.0.join(", "), files: files.len() });
    };
    let split = Split::new(data, first, last)?;
    let window = split.window();
    let timestamps = if data.resample.is_some() { Vec::new() } else { series.clock(&window)? };
    let irregularities = Irregularities { null_timestamps, ..Irregularities::default() };
    let channel = |tag: &super::series::Tag| Channel {
        name: tag.name.clone(),
        type_name: tag.type_name().to_owned(),
        description: Description::default(),
        readable: true,
        positions: HashMap::new(),
    };
    Ok(Planned {
        channels: series.tags.iter().map(channel).collect(),
        rows: Rows::of(timestamps, irregularities),
        origin: Origin::Series(series, window),
        files,
        shape,
        split,
        span: (first, last),
        bad_quality,
    })
}

impl Planned {
    fn into_log(self, data: &DataConfig) -> Result<Log, DataError> {
        let Self { origin, files, shape, channels, rows, split, span, bad_quality } = self;
        let (rows, recorded, grid) =
            match data.resample.zip(data.period_secs.and_then(Period::from_secs)) {
                None => (rows, None, None),
                Some((resample, period)) => {
                    let ranges = split.ranges_inside(span);
                    let grid = Grid::new(resample, period, data.max_age(period), ranges)?;
                    let timestamps = grid_rows(&grid, &origin, &rows)?;
                    (Rows::of(timestamps, Irregularities::default()), Some(rows), Some(grid))
                }
            };
        let (train, held_out) = row_ranges(data, &split, &rows.timestamps, span)?;
        if data.train.is_none()
            && let Some(held_out) = &held_out
        {
            split::refuse_lopsided(data.train_fraction, &rows.timestamps, &train, held_out)?;
        }
        // By the training range where that is enough: what is held out must not change what a model follows from.
        let detected = || {
            gaps::detect_period(&rows.timestamps[train.clone()])
                .or_else(|| gaps::detect_period(&rows.timestamps))
        };
        let period = data
            .period_secs
            .and_then(Period::from_secs)
            .or_else(detected)
            .ok_or_else(|| DataError::NoPeriod { at: format_time(rows.timestamps[0]) })?;
        Ok(Log {
            steps: gaps::find_steps(&rows.timestamps, &rows.breaks, period, data.gap_tolerance),
            period_was_detected: data.period_secs.is_none(),
            contradictions: data.contradictions,
            files,
            shape,
            origin,
            rows,
            recorded,
            grid,
            utc: false,
            bad_quality,
            channels,
            period,
            train,
            held_out,
        })
    }
}

fn grid_rows(
    grid: &Grid,
    origin: &Origin,
    recorded: &Rows,
) -> Result<Vec<calib_core::Timestamp>, DataError> {
    let mut coverage = grid.coverage();
    match origin {
        Origin::Tables(_) => {
            let times: Vec<i64> = recorded.timestamps.iter().map(|time| time.as_micros()).collect();
            grid.cover(&times, &mut coverage);
        }
        Origin::Series(series, window) => {
            for tag in 0..series.tags.len() {
                let (times, _) = series.samples(tag, window)?;
                grid.cover(&times, &mut coverage);
            }
        }
    }
    Ok(grid.rows(&coverage))
}

/// Wells and plants logged at the same time are not one log, however similar their channels.
fn refuse_mixed_partitions(
    files: &[LogFile],
    irregularities: &Irregularities,
) -> Result<(), DataError> {
    for &(first, second) in &irregularities.overlaps {
        refuse_pair(&files[first].source, &files[second].source, &|_| true)?;
    }
    Ok(())
}

/// Of samples the times of a file are not known apart: folders that are no dates and no tags are plants.
fn refuse_several_plants(sources: &[Source]) -> Result<(), DataError> {
    let known = ["year", "month", "day", "date", "dt", "hour", "tag", "sensor", "point", "channel"];
    let is_plant = |key: &str| !known.contains(&key.to_lowercase().as_str());
    sources.windows(2).try_for_each(|pair| refuse_pair(&pair[0], &pair[1], &is_plant))
}

fn refuse_pair(
    first: &Source,
    second: &Source,
    counts: &dyn Fn(&str) -> bool,
) -> Result<(), DataError> {
    let differing = first.partitions.iter().find(|(key, value)| {
        counts(key) && second.partitions.get(*key).is_some_and(|other| other != *value)
    });
    match differing {
        None => Ok(()),
        Some((key, value)) => Err(DataError::MixedPartitions {
            first: first.path.clone(),
            second: second.path.clone(),
            key: key.clone(),
            value: value.clone(),
        }),
    }
}

/// The union of the files' columns, in order of appearance.
fn list_channels(files: &[LogFile], times: &[usize]) -> Vec<Channel> {
    let mut channels: Vec<Channel> = Vec::new();
    let mut known: HashMap<String, usize> = HashMap::new();
    for (file, (log_file, &time)) in files.iter().zip(times).enumerate() {
        for (position, field) in log_file.fields.iter().enumerate() {
            if position == time {
                continue;
            }
            let index = *known.entry(field.name.clone()).or_insert_with(|| {
                channels.push(Channel {
                    name: field.name.clone(),
                    type_name: field.type_name.clone(),
                    description: field.description.clone(),
                    readable: false,
                    positions: HashMap::new(),
                });
                channels.len() - 1
            });
            let channel = &mut channels[index];
            if !channel.type_name.split(" or ").any(|known| known == field.type_name) {
                channel.type_name = format!("{} or {}", channel.type_name, field.type_name);
            }
            if matches!(field.kind, FieldKind::Number | FieldKind::Text) {
                channel.readable = true;
                channel.positions.insert(file, position);
            }
        }
    }
    channels
}
