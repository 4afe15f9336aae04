//! Opens and recognises the files of a log.

use std::{
    collections::{BTreeSet, HashMap},
    sync::Arc,
};

use calib_core::{Monitor, Period};
use calib_text::ParsedTime;

use super::{
    bad_rows_found::BadRowsFound,
    clock::{Clock, Fractions, Notations, notations},
    column_pairs::refuse_pairs,
    columns::{Imported, import},
    file::{Field, FieldKind, LogFile},
    head::{Head, HeadColumn},
    long::{stream_annotated, stream_parquet, stream_text},
    partitioned_file::PartitionedFile,
    plant_log::FileSummary,
    series::Sink,
    shape::{Recognised, Roles, recognise, time_column, told_by_words, with_quality},
    shared_times::{self, SharedTimes},
    source,
    store::{Store, Stored},
    times,
};
use crate::{
    Contradictions, DataConfig, DataError, Description, Shape, TimestampUnit, text::Notation,
};

/// Contents of the files, before rows and ranges are known.
#[expect(clippy::large_enum_variant, reason = "there is one for a log")]
pub(super) enum Opened {
    Tables(Tables),
    Samples(Samples),
}

/// Files of samples.
pub(super) struct Samples {
    pub(super) shape: Shape,
    pub(super) files: Vec<FileSummary>,
    pub(super) sink: Sink,
    /// Sentences about uncertain readings of files.
    pub(super) read_as: Vec<String>,
}

/// Wide files.
pub(super) struct Tables {
    pub(super) files: Vec<LogFile>,
    /// Position of the timestamp in each file.
    pub(super) times: Vec<usize>,
    /// Timestamps of each file.
    pub(super) instants: Vec<Vec<i64>>,
    /// Number of rows whose time names no instant, or two that no other row can tell apart.
    pub(super) undecided: u64,
    /// Number of rows that `data.where` excludes.
    pub(super) left_out: u64,
    pub(super) bad_rows: BadRowsFound,
    /// Whether rows have no times, so that they are numbered.
    pub(super) without_times: bool,
    /// Sentences about columns that are not read independently, such as joined times.
    pub(super) read_as: Vec<String>,
}

/// Finds, opens and recognises the files of a log. Also returns whether its times are UTC.
pub(super) fn open(data: &DataConfig, monitor: &dyn Monitor) -> Result<(Opened, bool), DataError> {
    let (sources, empty) = source::without_empty(source::find_files(data)?)?;
    monitor.begin("reading timestamps", sources.len() as u64);
    let mut heads = Vec::with_capacity(sources.len());
    for source in &sources {
        monitor.check()?;
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
    let times = time_columns(&mut heads, data)?;
    let without_times = (0..heads.len()).any(|at| has_no_times(&heads[at], times[at]));
    let recognised =
        if without_times { Recognised::Wide } else { recognise(&heads, &times, data)? };
    if matches!(recognised, Recognised::Wide) {
        heads.iter().try_for_each(|head| refuse_pairs(head, data))?;
    }
    let notations = match recognised {
        Recognised::Annotated => Notations::default(),
        Recognised::Wide | Recognised::Samples(..) | Recognised::OneColumn(_) => {
            notations(&heads, &times, data, monitor)?
        }
    };
    let fractions = Fractions::of(&heads, &times, data)?;
    let utc = data.time_zone.is_some() || is_utc(&heads, &times, &notations.of_files, data)?;
    let written = TextRead { notations, fractions, empty };
    let opened = match recognised {
        Recognised::Wide => tables(heads, times, &written, data, monitor).map(Opened::Tables),
        Recognised::Samples(shape, roles) => {
            refuse_several_plants(&sources)?;
            samples(shape, &heads, &roles, &written, data, monitor).map(Opened::Samples)
        }
        Recognised::OneColumn(roles) => {
            one_column(heads, times, roles, &sources, &written, data, monitor)
        }
        Recognised::Annotated => {
            let mut sink = Sink::new(Store::new(data)?);
            let clock = Clock::new(Notation::Iso, data);
            stream_annotated(&heads, &clock, &mut sink, monitor)?;
            let files = heads.iter().map(|head| summary(head, 0)).collect();
            Ok(Opened::Samples(Samples {
                shape: Shape::Long,
                files,
                sink,
                read_as: written.doubts(),
            }))
        }
    };
    Ok((opened?, utc))
}

/// Reads files whose columns of values have one name. They are of a tag each if the study asks for tags, or if some
/// were recorded at the same time and are not exports of one sensor. Otherwise they are wide tables.
fn one_column(
    heads: Vec<Head>,
    times: Vec<usize>,
    roles: Vec<Roles>,
    sources: &[PartitionedFile],
    written: &TextRead,
    data: &DataConfig,
    monitor: &dyn Monitor,
) -> Result<Opened, DataError> {
    let (files, mut sink) = poured(&heads, &roles, written, data, monitor)?;
    let pair = sink.least_alike()?;
    let is_asked = data.shape == Some(Shape::FilePerTag);
    let are_tags = pair.as_ref().is_some_and(|pair| is_asked || !pair.is_of_one_sensor());
    let doubt = pair.filter(|_| !is_asked).and_then(|pair| pair.doubt());
    if !are_tags {
        drop(sink);
        monitor.begin("reading timestamps", sources.len() as u64);
        let mut tables = tables(heads, times, written, data, monitor)?;
        tables.read_as.extend(doubt);
        return Ok(Opened::Tables(tables));
    }
    refuse_several_plants(sources)?;
    let known = with_quality(&heads, roles, data)?;
    let shape = Shape::FilePerTag;
    let mut samples = if known.iter().all(|roles| roles.quality.is_none()) {
        Samples { shape, files, sink, read_as: written.doubts() }
    } else {
        drop(sink);
        monitor.begin("reading timestamps", sources.len() as u64);
        samples(shape, &heads, &known, written, data, monitor)?
    };
    samples.read_as.extend(doubt);
    Ok(Opened::Samples(samples))
}

/// Returns the position of the time column of each file; for files without one the position after the last column.
fn time_columns(heads: &mut [Head], data: &DataConfig) -> Result<Vec<usize>, DataError> {
    let mut found: Vec<Option<usize>> = heads
        .iter()
        .map(|head| match head {
            Head::Annotated(..) => Some(0),
            _ => time_column(head, &head.columns(), data),
        })
        .collect();
    if data.timestamp == DataConfig::default().timestamp {
        for (found, head) in
            found.iter_mut().zip(heads.iter_mut()).filter(|(known, _)| known.is_none())
        {
            *found = times::join_fields(head);
        }
    }
    // In a file whose first lines are damaged, the time column has the same name as in the others.
    let names: Vec<Vec<HeadColumn>> = heads.iter().map(Head::columns).collect();
    let known: BTreeSet<&str> =
        (0..heads.len()).filter_map(|at| Some(names[at].get(found[at]?)?.name.as_str())).collect();
    let known: Vec<&str> = known.into_iter().collect();
    if let [name] = known[..] {
        for (found, names) in found.iter_mut().zip(&names) {
            *found = found.or_else(|| names.iter().position(|column| column.name == name));
        }
    }
    let is_default = data.timestamp == DataConfig::default().timestamp;
    if data.period_secs.is_some()
        && is_default
        && found.iter().all(Option::is_none)
        && heads.iter().all(|head| times::likely_times(head).is_empty())
    {
        return Ok(names.iter().map(Vec::len).collect());
    }
    let others = found.iter().flatten().count();
    if is_default {
        let without = heads.iter().zip(&found).filter(|(_, found)| found.is_none());
        without.map(|(head, _)| head).try_for_each(|head| refuse_pairs(head, data))?;
    }
    let mut times = Vec::with_capacity(heads.len());
    for (head, found) in heads.iter_mut().zip(found) {
        let time = found.ok_or_else(|| times::no_timestamp(head, others, data))?;
        times.push(times::join_times(head, time)?);
    }
    Ok(times)
}

/// Whether `time` is after the last column.
fn has_no_times(head: &Head, time: usize) -> bool {
    !matches!(head, Head::Annotated(..)) && time >= head.columns().len()
}

/// Periods between the last row of one file without times and the first row of the next: no transition crosses them.
const BETWEEN_FILES: i64 = 10;

/// The notation of text.
struct TextRead {
    notations: Notations,
    /// The notation of numbers in all files.
    fractions: Fractions,
    /// The warning about empty files.
    empty: Option<String>,
}

impl TextRead {
    /// Returns sentences about ignored files, and readings that are likely but not certain.
    fn doubts(&self) -> Vec<String> {
        let likely = self.notations.doubts.iter().chain(&self.fractions.doubt);
        likely.chain(&self.empty).cloned().collect()
    }

    /// Creates the store that text is read into.
    fn store(&self, data: &DataConfig) -> Result<Store, DataError> {
        let mut store = Store::new(data)?;
        store.signs.adopt(self.fractions.told_by.clone().unwrap_or_default());
        Ok(store)
    }
}

/// Whether the files define the instants of their times, by an offset, a zone, or as numbers since 1970.
fn is_utc(
    heads: &[Head],
    times: &[usize],
    notations: &[Notation],
    data: &DataConfig,
) -> Result<bool, DataError> {
    // With a format, numbers are dates without a zone.
    let numbers_count = match data.timestamp_unit {
        None => data.timestamp_format.is_none(),
        Some(unit) => unit != TimestampUnit::Excel,
    };
    let mut all = true;
    for (position, (head, &time)) in heads.iter().zip(times).enumerate() {
        all &= match head {
            Head::Annotated(..) => true,
            Head::Parquet(file) => file.fields.get(time).is_some_and(|field| {
                field.kind == FieldKind::Number && numbers_count
                    || field.type_name.starts_with("datetime in")
            }),
            Head::Text(_) => {
                let sample = head.sample(time)?;
                let stamp = sample.first().and_then(|text| notations[position].read(text));
                matches!(stamp, Some(ParsedTime::Instant(_)))
            }
        };
    }
    Ok(all)
}

fn field_of(column: &crate::text::TextColumn, is_words_only: bool) -> Field {
    let (kind, type_name) =
        if is_words_only { (FieldKind::Text, "text") } else { (FieldKind::Number, "number") };
    Field {
        name: column.name.clone(),
        kind,
        type_name: type_name.to_owned(),
        description: Description { unit: column.unit.clone(), label: column.label.clone() },
    }
}

fn tables(
    heads: Vec<Head>,
    times: Vec<usize>,
    written: &TextRead,
    data: &DataConfig,
    monitor: &dyn Monitor,
) -> Result<Tables, DataError> {
    let mut store = written.store(data)?;
    let mut imported: HashMap<usize, Imported> = HashMap::new();
    let mut undecided = 0;
    for (position, (head, notation)) in heads.iter().zip(&written.notations.of_files).enumerate() {
        if let Head::Text(file) = head {
            let clock = Clock::new(notation.clone(), data);
            let time = times[position];
            let read = import(file, time, &clock, &written.fractions, &mut store, monitor)?;
            undecided += read.undecided;
            imported.insert(position, read);
        }
    }
    let store = Arc::new(store);
    let read_as: BTreeSet<String> = heads.iter().flat_map(read_as).collect();
    let mut files = Vec::with_capacity(heads.len());
    for (position, head) in heads.into_iter().enumerate() {
        files.push(match (head, imported.remove(&position)) {
            (Head::Text(file), Some(read)) => {
                let source = PartitionedFile::of(file.path.clone());
                let columns = file.columns().iter().zip(&read.words_only);
                let fields = columns.map(|(column, words)| field_of(column, *words)).collect();
                let stored =
                    Stored { columns: read.columns, times: read.times, store: Arc::clone(&store) };
                LogFile::stored(source, fields, &file, stored)
            }
            (Head::Parquet(file), _) => *file,
            (Head::Text(_) | Head::Annotated(..), _) => continue,
        });
    }
    let bad_rows = store.bad_rows.clone();
    bad_rows.refuse(files.iter().map(|file| file.rows as u64).sum(), data)?;
    let mut instants = Vec::with_capacity(files.len());
    let mut left_out = 0;
    let mut next = 0;
    let period = data.period_secs.and_then(Period::from_secs).map_or(1, Period::as_micros);
    let mut without_times = false;
    let mut spread = BTreeSet::new();
    for (file, &time) in files.iter().zip(&times) {
        monitor.check()?;
        if time < file.fields.len() {
            let mut read = times::read_timestamps(file, time, data)?;
            if data.contradictions == Contradictions::Spread {
                spread.extend(shared_times::spread(&mut read.instants).map(SharedTimes::told));
            }
            instants.push(read.instants);
            undecided += read.undecided;
            left_out += read.left_out;
        } else {
            without_times = true;
            let rows = 0..i64::try_from(file.rows).unwrap_or(i64::MAX);
            instants.push(rows.map(|row| next + row.saturating_mul(period)).collect());
            let rows = file.rows as i64 + BETWEEN_FILES;
            next = rows.saturating_mul(period).saturating_add(next);
        }
        monitor.advance(1);
    }
    Ok(Tables {
        files,
        times,
        instants,
        undecided,
        left_out,
        bad_rows,
        without_times,
        read_as: read_as.into_iter().chain(spread).chain(written.doubts()).collect(),
    })
}

/// Returns sentences about columns of a file that are not read independently.
fn read_as(head: &Head) -> Vec<String> {
    match head {
        Head::Text(file) => file.read_as(),
        Head::Parquet(_) | Head::Annotated(..) => Vec::new(),
    }
}

fn samples(
    shape: Shape,
    heads: &[Head],
    roles: &[Roles],
    written: &TextRead,
    data: &DataConfig,
    monitor: &dyn Monitor,
) -> Result<Samples, DataError> {
    let (files, sink) = poured(heads, roles, written, data, monitor)?;
    let read_as = [written.doubts(), told_by_words(roles)].concat();
    Ok(Samples { shape, files, sink, read_as })
}

/// Returns the samples of all files, by their tags.
fn poured(
    heads: &[Head],
    roles: &[Roles],
    written: &TextRead,
    data: &DataConfig,
    monitor: &dyn Monitor,
) -> Result<(Vec<FileSummary>, Sink), DataError> {
    let mut sink = Sink::new(written.store(data)?);
    let mut files = Vec::with_capacity(heads.len());
    for ((head, roles), notation) in heads.iter().zip(roles).zip(&written.notations.of_files) {
        let before = sink.rows;
        let clock = Clock::new(notation.clone(), data);
        match head {
            Head::Text(file) => {
                stream_text(file, roles, &clock, &written.fractions, &mut sink, monitor)?;
            }
            Head::Parquet(file) => stream_parquet(file, roles, &clock, data, &mut sink, monitor)?,
            Head::Annotated(..) => {}
        }
        files.push(summary(head, (sink.rows - before) as usize));
        monitor.advance(1);
    }
    sink.store.bad_rows.refuse(sink.rows, data)?;
    Ok((files, sink))
}

fn summary(head: &Head, rows: usize) -> FileSummary {
    let bytes = match head {
        Head::Parquet(file) => file.bytes,
        Head::Text(file) => file.bytes,
        Head::Annotated(_, bytes) => *bytes,
    };
    FileSummary { path: head.path().to_owned(), bytes, rows }
}

/// Names of folders that hold dates or tags.
const NO_PLANTS: [&str; 10] =
    ["year", "month", "day", "date", "dt", "hour", "tag", "sensor", "point", "channel"];

fn is_plant(key: &str) -> bool {
    !NO_PLANTS.contains(&key.to_lowercase().as_str())
}

/// The times of single files of samples are unknown here. So folders that are neither dates nor tags count as plants.
fn refuse_several_plants(sources: &[PartitionedFile]) -> Result<(), DataError> {
    sources.windows(2).try_for_each(|pair| refuse_pair(&pair[0], &pair[1], &is_plant))
}

pub(super) fn refuse_pair(
    first: &PartitionedFile,
    second: &PartitionedFile,
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
