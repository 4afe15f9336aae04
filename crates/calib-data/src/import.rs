//! Converts a log of any form to one wide Parquet file.

use std::{collections::BTreeMap, io, path::Path};

use calib_core::{Cancelled, Monitor, Timestamp};
use calib_files::{ExistingFile, FileError, Spill, check_output, is_same_file, write_output};
use pl::{IntoColumn as _, NewChunkedArray as _};
use polars::prelude as pl;
use schemars::JsonSchema;
use serde::Serialize;

use crate::{
    BadRowsFound, DataConfig, DataError, Shape,
    log::{Batch, Codes, Contradicting, Log, MemoryLimit, log_files},
};

/// Maximum memory of a row group before it is written, in bytes.
const GROUP_BYTES: usize = 64 << 20;
/// Maximum number of rows of a row group.
const GROUP_ROWS: usize = 1 << 20;

/// Summary of an import.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Imported {
    /// The content of one row of the files.
    pub shape: Shape,
    /// Number of files that were read.
    pub files: usize,
    /// Seconds between rows that are counted, because the files have no times. Default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub counted_secs: Option<f64>,
    /// Rows in the files. They are samples if each row is one sample.
    pub file_rows: u64,
    /// Rows written, one for each instant.
    pub rows: usize,
    /// Columns, not counting the timestamp.
    pub channels: usize,
    /// Rows and samples of the files that were dropped or changed.
    pub dropped: Dropped,
    /// Words that became missing values, by channel, the most frequent first.
    pub words: BTreeMap<String, Vec<(String, u64)>>,
    /// NaN, infinite values and values beyond ±1e150 that became missing values, by channel.
    pub non_finite: BTreeMap<String, u64>,
    /// Columns of neither numbers nor text, with their types.
    pub unreadable: BTreeMap<String, String>,
}

/// Rows of the files that are not rows of the log.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, JsonSchema)]
pub struct Dropped {
    /// Rows without a timestamp in the years 1 to 9998.
    pub without_time: u64,
    /// Rows among these whose local time is in an hour that clocks showed twice, or never, and that no other row decides.
    pub undecided: u64,
    /// Rows merged into another row of the same time (for samples: of the same time and tag).
    pub repeated: u64,
    /// Samples that are missing because of their quality code.
    pub bad_quality: u64,
    /// Lines of text files that cannot be read, under `data.bad_rows = "skip"`. Default: none.
    #[serde(skip_serializing_if = "BadRowsFound::is_none")]
    pub bad_rows: BadRowsFound,
}

/// The place where the values of a channel wait for their row groups.
struct Column {
    name: String,
    at: u64,
    /// Labels that the values are indices of, for a channel of words.
    labels: Option<Vec<String>>,
}

/// Writes the log that `data` names as one Parquet file, with its rows in time order and each instant once. It has the
/// column `timestamp` (microseconds, no time zone: UTC if the log has a zone) and one `f64` column per channel, or a
/// text column for a channel of words only. `data.include`, `exclude` and `resample` apply; ranges do not.
///
/// Memory holds the timestamps, a batch of channels, and a row group of at most 64 MB.
///
/// # Errors
/// If the log cannot be read or contradicts itself, or if the file cannot be written: because it exists and must be
/// kept, or is a part of the log.
pub fn import(
    data: &DataConfig,
    path: &Path,
    existing: ExistingFile,
    monitor: &dyn Monitor,
) -> Result<Imported, DataError> {
    check_output(path, existing)?;
    if log_files(data)?.iter().any(|log| is_same_file(log, path)) {
        return Err(FileError::Input { path: path.to_owned() }.into());
    }
    let (log, wanted) = Log::open_whole(data, monitor)?;
    let rows = log.rows.timestamps.len();
    MemoryLimit::of(data).require(
        writer_bytes(rows, wanted.len()),
        || format!("writing {rows} rows of {} channels", wanted.len()),
        "choose channels with data.include, or put them on one clock with data.resample",
    )?;
    let mut imported = Imported {
        shape: log.shape,
        files: log.files.len(),
        counted_secs: log.without_times.then(|| log.period.as_secs()),
        file_rows: log.files.iter().map(|file| file.rows as u64).sum(),
        rows,
        channels: wanted.len(),
        dropped: Dropped {
            without_time: log.recorded().irregularities.null_timestamps,
            undecided: log.undecided,
            repeated: log.recorded().duplicates.len() as u64 - log.merged_rows(),
            bad_quality: log.bad_quality,
            bad_rows: log.bad_rows.clone(),
        },
        words: BTreeMap::new(),
        non_finite: BTreeMap::new(),
        unreadable: log.unreadable(data),
    };
    let mut spill = Spill::new(&data.scratch)?;
    let columns = spill_columns(&log, &wanted, &mut spill, &mut imported, monitor)?;
    write((path, existing), &log.rows.timestamps, &columns, &spill, monitor)?;
    Ok(imported)
}

fn group_rows(columns: usize) -> usize {
    (GROUP_BYTES / ((columns + 1) * size_of::<f64>())).clamp(1, GROUP_ROWS)
}

/// Returns the memory for writing, in bytes: per column, and per column and row group for its entry in the footer.
fn writer_bytes(rows: usize, columns: usize) -> u64 {
    const COLUMN: u64 = 12 << 10;
    const CHUNK: u64 = 1 << 11;
    let groups = rows.div_ceil(group_rows(columns)) as u64;
    (columns as u64).saturating_mul(groups.saturating_mul(CHUNK).saturating_add(COLUMN))
}

fn spill_columns(
    log: &Log,
    wanted: &[usize],
    spill: &mut Spill,
    imported: &mut Imported,
    monitor: &dyn Monitor,
) -> Result<Vec<Column>, DataError> {
    let mut columns = Vec::with_capacity(wanted.len());
    let mut batch = Batch::default();
    let mut repeated: Vec<(usize, u64)> = Vec::new();
    let mut contradicting: Vec<(usize, Contradicting)> = Vec::new();
    monitor.begin("reading channels", wanted.len() as u64);
    for channels in wanted.chunks(log.batch_size()) {
        let read = log.read(channels, &mut batch, monitor)?;
        for (&channel, values) in channels.iter().zip(read) {
            let name = log.channels[channel].name.clone();
            contradicting.push((channel, std::mem::take(&mut values.contradictions)));
            repeated.push((channel, values.repeated));
            if values.not_numbers.non_finite > 0 {
                imported.non_finite.insert(name.clone(), values.not_numbers.non_finite);
            }
            let has_words = !values.not_numbers.words.is_empty();
            let is_text = values.not_numbers.switch.is_some()
                || has_words && values.values.iter().all(|value| value.is_nan());
            let labels = if is_text {
                let Codes { codes, labels } = log.read_codes(channel, monitor)?;
                values.values = codes;
                Some(labels)
            } else {
                if has_words {
                    imported.words.insert(name.clone(), values.not_numbers.by_frequency());
                }
                None
            };
            let at = spill.append(bytemuck::cast_slice(&values.values))?;
            columns.push(Column { name, at, labels });
        }
    }
    imported.dropped.repeated +=
        log.by_recorded_name(&repeated).into_iter().map(|(_, times)| times).sum::<u64>();
    log.refuse_contradictions(&contradicting, monitor)?;
    Ok(columns)
}

fn write(
    (path, existing): (&Path, ExistingFile),
    timestamps: &[Timestamp],
    columns: &[Column],
    spill: &Spill,
    monitor: &dyn Monitor,
) -> Result<(), DataError> {
    let group = group_rows(columns.len());
    monitor.begin("writing rows", timestamps.len() as u64);
    let mut interrupted = false;
    let written = write_output(path, existing, |file| {
        let empty = frame(&[], 0, columns, spill)?;
        let mut writer = pl::ParquetWriter::new(file)
            .with_compression(pl::ParquetCompression::Zstd(None))
            .batched(empty.schema())
            .map_err(io::Error::other)?;
        for (number, timestamps) in timestamps.chunks(group).enumerate() {
            if monitor.interrupted() {
                interrupted = true;
                return Err(io::Error::other("interrupted"));
            }
            let frame = frame(timestamps, number * group, columns, spill)?;
            writer.write_batch(&frame).map_err(io::Error::other)?;
            monitor.advance(timestamps.len() as u64);
        }
        writer.finish().map_err(io::Error::other)?;
        Ok(())
    });
    if interrupted {
        return Err(Cancelled.into());
    }
    Ok(written?)
}

/// Returns the rows from `first` on.
fn frame(
    timestamps: &[Timestamp],
    first: usize,
    columns: &[Column],
    spill: &Spill,
) -> io::Result<pl::DataFrame> {
    let rows = timestamps.len();
    let times = timestamps.iter().map(|time| time.as_micros()).collect::<Vec<i64>>();
    let times = pl::Int64Chunked::from_vec("timestamp".into(), times)
        .into_datetime(pl::TimeUnit::Microseconds, None)
        .into_column();
    let mut all = vec![times];
    let mut values = vec![0.0_f64; rows];
    for column in columns {
        let at = column.at + (first * size_of::<f64>()) as u64;
        spill.read(at, bytemuck::cast_slice_mut(&mut values)).map_err(io::Error::other)?;
        let name = column.name.as_str().into();
        let present = values.iter().map(|&value| (!value.is_nan()).then_some(value));
        all.push(match &column.labels {
            None => pl::Float64Chunked::from_iter_options(name, present).into_column(),
            Some(labels) => pl::StringChunked::from_iter_options(
                name,
                present.map(|code| code.map(|code| labels[code as usize].as_str())),
            )
            .into_column(),
        });
    }
    pl::DataFrame::new(rows, all).map_err(io::Error::other)
}
