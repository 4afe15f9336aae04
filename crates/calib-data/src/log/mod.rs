//! The log as it lies in its files: rows in time order, channels, ranges.

mod file;
mod gaps;
mod passes;
mod read;
mod rows;
mod source;
mod split;
mod times;
mod values;

use std::{collections::HashMap, ops::Range, path::PathBuf};

use calib_core::{Monitor, Period, Timestamp};

use self::{file::LogFile, rows::Rows, split::Split};
pub(crate) use self::{
    file::{FieldKind, classify},
    gaps::{Steps, inside},
    read::{Batch, ChannelValues, Codes},
    rows::{EXAMPLES, Irregularities},
    values::NotNumbers,
};
use crate::{DataConfig, DataError, time::format_time};

/// Everything about the log except the values of its channels.
pub(crate) struct Log {
    pub(crate) files: Vec<LogFile>,
    pub(crate) rows: Rows,
    pub(crate) channels: Vec<Channel>,
    pub(crate) period: Period,
    pub(crate) period_was_detected: bool,
    pub(crate) steps: Steps,
    /// Rows of the training range.
    pub(crate) train: Range<usize>,
    /// Rows of the held-out range.
    pub(crate) held_out: Option<Range<usize>>,
}

/// A column of the files that is not the timestamp.
#[derive(Clone, Debug)]
pub(crate) struct Channel {
    pub(crate) name: String,
    /// Its types, in order of appearance; more than one if files disagree.
    pub(crate) type_name: String,
    /// Whether a file has it as numbers or text.
    pub(crate) readable: bool,
    /// Its position in each file that has it readable.
    positions: HashMap<usize, usize>,
}

impl Log {
    pub(crate) fn open(data: &DataConfig, monitor: &dyn Monitor) -> Result<Self, DataError> {
        data.check()?;
        let sources = source::find_files(data)?;
        monitor.begin("reading timestamps", sources.len() as u64);
        let mut files = Vec::with_capacity(sources.len());
        let mut times = Vec::with_capacity(sources.len());
        for source in sources {
            if monitor.interrupted() {
                return Err(DataError::Interrupted);
            }
            let file = LogFile::open(source)?;
            monitor.advance(1);
            if file.is_result {
                continue;
            }
            times.push(times::read_timestamps(&file, data)?);
            files.push(file);
        }
        if files.is_empty() {
            return Err(DataError::NoFile {
                pattern: data.path.0.join(", "),
                reason: "the only Parquet files there are results of calib, which are no logs"
                    .to_owned(),
            });
        }
        let total: usize = times.iter().map(Vec::len).sum();
        if u32::try_from(total).is_err() {
            return Err(DataError::TooManyRows { rows: total as u64 });
        }
        let present = || times.iter().flatten().copied().filter(|&time| time != rows::NO_TIME);
        let (Some(first), Some(last)) = (present().min(), present().max()) else {
            return Err(DataError::NoRows { path: data.path.0.join(", "), files: files.len() });
        };
        let split = Split::new(data, first, last)?;
        let rows = Rows::plan(&times, &split.window());
        drop(times);
        refuse_mixed_partitions(&files, &rows.irregularities)?;
        let (train, held_out) = row_ranges(data, &split, &rows.timestamps, first, last)?;
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
        Ok(Self {
            channels: list_channels(&files, &data.timestamp),
            steps: gaps::find_steps(&rows.timestamps, &rows.breaks, period, data.gap_tolerance),
            period_was_detected: data.period_secs.is_none(),
            period,
            train,
            held_out,
            rows,
            files,
        })
    }

    /// Stretches without a gap, cut at the ends of the two ranges; rows outside both are left out.
    pub(crate) fn stretches(&self) -> Vec<Range<usize>> {
        let mut parts: Vec<&Range<usize>> =
            [&self.train].into_iter().chain(&self.held_out).collect();
        parts.sort_by_key(|part| part.start);
        let stretches = parts.into_iter().flat_map(|part| inside(&self.steps.stretches, part));
        stretches.collect()
    }
}

fn row_ranges(
    data: &DataConfig,
    split: &Split,
    timestamps: &[Timestamp],
    first: i64,
    last: i64,
) -> Result<(Range<usize>, Option<Range<usize>>), DataError> {
    let rows = |key, configured: Option<String>, range: &Range<i64>| {
        let rows = split::rows_in(timestamps, range);
        if rows.is_empty() {
            let at = |micros| format_time(Timestamp::from_micros(micros));
            return Err(DataError::OutsideData {
                key,
                range: configured.unwrap_or_default(),
                start: at(first),
                end: at(last),
            });
        }
        Ok(rows)
    };
    let text = |range: &Option<crate::TimeRange>| range.as_ref().map(ToString::to_string);
    let train = rows("train", text(&data.train), &split.train)?;
    let held_out = split
        .held_out
        .as_ref()
        .map(|range| rows("held_out", text(&data.held_out), range))
        .transpose()?;
    Ok((train, held_out))
}

/// Wells and plants logged at the same time are not one log, however similar their channels.
fn refuse_mixed_partitions(
    files: &[LogFile],
    irregularities: &Irregularities,
) -> Result<(), DataError> {
    for &(first, second) in &irregularities.overlaps {
        let (first, second) = (&files[first].source, &files[second].source);
        let differing = first
            .partitions
            .iter()
            .find(|(key, value)| second.partitions.get(*key).is_some_and(|other| other != *value));
        if let Some((key, value)) = differing {
            return Err(DataError::MixedPartitions {
                first: first.path.clone(),
                second: second.path.clone(),
                key: key.clone(),
                value: value.clone(),
            });
        }
    }
    Ok(())
}

/// The files that `data` selects, in order of their names. Nothing of them is read; some may turn out to be results of
/// calib, which are no logs.
///
/// # Errors
/// If a pattern selects nothing, or a folder cannot be read.
pub fn log_files(data: &DataConfig) -> Result<Vec<PathBuf>, DataError> {
    Ok(source::find_files(data)?.into_iter().map(|source| source.path).collect())
}

/// What the footers of a log say, before anything of it is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Declared {
    /// Rows of all files.
    pub rows: u64,
    /// Memory that reading takes at the least, in bytes: the states come on top of it.
    pub least_bytes: u64,
}

impl Declared {
    /// Read the footers of the files that `data` names.
    ///
    /// # Errors
    /// If there are none, or one is not Parquet.
    pub fn of(data: &DataConfig) -> Result<Self, DataError> {
        let mut rows = 0_u64;
        for source in source::find_files(data)? {
            let file = LogFile::open(source)?;
            rows = rows.saturating_add(if file.is_result { 0 } else { file.rows as u64 });
        }
        Ok(Self { rows, least_bytes: rows.saturating_mul(BYTES_PER_ROW) })
    }
}

/// Per row: the timestamp as it is read and in order, and two channels at least that are read together, each as the file
/// has it and as numbers.
const BYTES_PER_ROW: u64 = 8 + 8 + 2 * (8 + 8);

/// The union of the files' columns, in order of appearance.
fn list_channels(files: &[LogFile], timestamp: &str) -> Vec<Channel> {
    let mut channels: Vec<Channel> = Vec::new();
    let mut known: HashMap<String, usize> = HashMap::new();
    for (file, log_file) in files.iter().enumerate() {
        for (position, field) in log_file.fields.iter().enumerate() {
            if field.name == timestamp {
                continue;
            }
            let index = *known.entry(field.name.clone()).or_insert_with(|| {
                channels.push(Channel {
                    name: field.name.clone(),
                    type_name: field.type_name.clone(),
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
