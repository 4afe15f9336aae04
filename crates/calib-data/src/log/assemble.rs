//! Assembles a log from the contents of its files: sorts its rows by time and splits them into ranges.

use std::collections::HashMap;

use calib_core::{Monitor, Period};
use calib_text::format_time;

use super::{
    alike_names::differing_in_case,
    angles::with_angles,
    bad_rows_found::BadRowsFound,
    file::{FieldKind, LogFile},
    filename_tag::prefixes,
    gaps,
    max_ages::max_ages,
    memory_limit::MemoryLimit,
    open::{self, Opened, Samples, Tables, refuse_pair},
    plant_log::{Channel, FileSummary, Log, Origin},
    resample::{Coverage, Grid},
    rows::{Irregularities, NO_TIME, Rows},
    split::{self, Split, row_ranges},
};
use crate::{
    DataConfig, DataError, Description, Shape,
    names::{Chosen, Names},
};

/// The rows of a log before they are split into ranges.
struct Planned {
    origin: Origin,
    files: Vec<FileSummary>,
    shape: Shape,
    channels: Vec<Channel>,
    rows: Rows,
    split: Split,
    /// The first and the last instant of all rows.
    span: (i64, i64),
    bad_quality: u64,
    undecided: u64,
    bad_rows: BadRowsFound,
    without_times: bool,
    read_as: Vec<String>,
}

impl Log {
    pub(crate) fn open(data: &DataConfig, monitor: &dyn Monitor) -> Result<Self, DataError> {
        data.check()?;
        let (opened, utc) = open::open(data, monitor)?;
        opened.into_log(utc, data)
    }

    /// Opens the whole log without ranges. Also returns the channels that can be read and are chosen.
    pub(crate) fn open_whole(
        data: &DataConfig,
        monitor: &dyn Monitor,
    ) -> Result<(Self, Vec<usize>), DataError> {
        let whole = DataConfig { train: None, held_out: None, train_fraction: 1.0, ..data.clone() };
        let log = Self::open(&whole, monitor)?;
        Names::new(&data.include).check(log.channels.iter().flat_map(Channel::names))?;
        let chosen = Chosen::of(data);
        let channels = log.channels.iter().enumerate();
        let wanted = channels
            .filter(|(_, channel)| channel.readable && chosen.has(&channel.names()))
            .map(|(position, _)| position)
            .collect();
        Ok((log, wanted))
    }
}

impl Opened {
    pub(super) fn into_log(self, utc: bool, data: &DataConfig) -> Result<Log, DataError> {
        let mut planned = match self {
            Self::Tables(tables) => plan_tables(tables, data)?,
            Self::Samples(samples) => plan_samples(samples, data)?,
        };
        // Names of a long table are no headers of files.
        if planned.shape != Shape::Long {
            planned.read_as.extend(differing_in_case(&planned.channels, data));
        }
        Ok(Log { utc, ..planned.into_log(data)? })
    }
}

fn plan_tables(tables: Tables, data: &DataConfig) -> Result<Planned, DataError> {
    let Tables { files, times, instants, undecided, left_out, bad_rows, without_times, read_as } =
        tables;
    let total: usize = instants.iter().map(Vec::len).sum();
    MemoryLimit::of(data).require_rows(total as u64, None)?;
    let present = instants.iter().flatten().copied().filter(|&time| time != NO_TIME);
    let (Some(first), Some(last)) = (present.clone().min(), present.max()) else {
        let path = data.path.0.join(", ");
        let without_time = total as u64;
        return Err(DataError::NoRows { path, files: files.len(), without_time });
    };
    let split = Split::new(data, first, last)?;
    let mut rows = Rows::plan(&instants, &split.window());
    rows.irregularities.null_timestamps -= left_out;
    if !data.file_as_prefix {
        refuse_mixed_partitions(&files, &rows.irregularities)?;
    }
    Ok(Planned {
        channels: list_channels(&files, &times, data.file_as_prefix),
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
        undecided,
        bad_rows,
        without_times,
        read_as,
    })
}

fn plan_samples(samples: Samples, data: &DataConfig) -> Result<Planned, DataError> {
    let Samples { shape, files, sink, mut read_as } = samples;
    if data.file_as_prefix {
        return Err(DataError::config(
            "data.file_as_prefix".to_owned(),
            "true".to_owned(),
            "false, because these files have one value per row. If several devices have the same tags, choose one with data.where, or name the \
             files of one in data.path",
        ));
    }
    let null_timestamps = sink.null_times;
    let bad_quality = sink.bad_quality;
    let undecided = sink.undecided;
    let bad_rows = sink.store.bad_rows.clone();
    read_as.extend(sink.mixed_tags());
    let series = sink.finish()?;
    let Some((first, last)) = series.span() else {
        let path = data.path.0.join(", ");
        let without_time = null_timestamps;
        return Err(DataError::NoRows { path, files: files.len(), without_time });
    };
    let split = Split::new(data, first, last)?;
    let window = split.window();
    let timestamps = if data.resample.is_some() { Vec::new() } else { series.clock(&window)? };
    MemoryLimit::of(data).require_rows(timestamps.len() as u64, None)?;
    let irregularities = Irregularities { null_timestamps, ..Irregularities::default() };
    Ok(Planned {
        channels: series
            .tags
            .iter()
            .enumerate()
            .map(|(column, tag)| Channel {
                name: tag.name.clone(),
                type_name: tag.type_name().to_owned(),
                description: Description::default(),
                readable: true,
                angle: None,
                column,
                positions: HashMap::new(),
            })
            .collect(),
        rows: Rows::of(timestamps, irregularities),
        origin: Origin::Series(series, window),
        files,
        shape,
        split,
        span: (first, last),
        bad_quality,
        undecided,
        bad_rows,
        without_times: false,
        read_as,
    })
}

impl Planned {
    fn into_log(self, data: &DataConfig) -> Result<Log, DataError> {
        let Self {
            origin,
            files,
            shape,
            channels,
            rows,
            split,
            span,
            bad_quality,
            undecided,
            bad_rows,
            without_times,
            read_as,
        } = self;
        let channels = with_angles(channels, data)?;
        let given_period = data.period_secs.and_then(Period::from_secs);
        let (rows, recorded, grid) = match data.resample.zip(given_period) {
            None => (rows, None, None),
            Some((resample, period)) => {
                let ranges = split.ranges_inside(span);
                let grid = Grid::new(resample, period, data.max_age(period), ranges);
                let timestamps = grid_rows(&grid, &origin, &rows, data)?;
                let recorded = match &origin {
                    Origin::Tables(_) => rows.timestamps.len() as u64 * channels.len() as u64,
                    Origin::Series(series, _) => series.count(),
                };
                refuse_too_fine(timestamps.len(), recorded, &channels, data)?;
                (Rows::of(timestamps, Irregularities::default()), Some(rows), Some(grid))
            }
        };
        let max_ages = match given_period {
            Some(period) if grid.is_some() => max_ages(&channels, data, period)?,
            _ => Vec::new(),
        };
        let (train, held_out) = row_ranges(data, &split, &rows.timestamps, span)?;
        if data.train.is_none()
            && let Some(held_out) = &held_out
        {
            split::refuse_lopsided(data.train_fraction, &rows.timestamps, &train, held_out)?;
        }
        let period = given_period
            // The training range is enough if it has a period: the held-out range must not change what a model is built
            // from.
            .or_else(|| gaps::detect_period(&rows.timestamps[train.clone()]))
            .or_else(|| gaps::detect_period(&rows.timestamps))
            .ok_or_else(|| DataError::NoPeriod { at: format_time(rows.timestamps[0]) })?;
        Ok(Log {
            steps: gaps::find_steps(&rows.timestamps, &rows.breaks, period, data.gap_tolerance),
            period_was_detected: data.period_secs.is_none(),
            contradictions: data.contradictions,
            missing_values: data.missing_values.clone(),
            files,
            shape,
            origin,
            rows,
            recorded,
            grid,
            max_ages,
            utc: false,
            bad_rows,
            without_times,
            read_as,
            bad_quality,
            undecided,
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
    data: &DataConfig,
) -> Result<Vec<calib_core::Timestamp>, DataError> {
    let mut coverage = Coverage::new();
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
    MemoryLimit::of(data).require_rows(coverage.rows(), data.period_secs)?;
    Ok(grid.rows(&mut coverage))
}

/// A log of more values must have recorded at least a thousandth of them. Otherwise the result would repeat the same
/// values again and again.
const MANY: u64 = 2_000_000_000;

fn refuse_too_fine(
    rows: usize,
    samples: u64,
    channels: &[Channel],
    data: &DataConfig,
) -> Result<(), DataError> {
    let chosen = Chosen::of(data);
    let values = (rows as u64).saturating_mul(
        channels.iter().filter(|channel| channel.readable && chosen.has(&channel.names())).count()
            as u64,
    );
    if values > MANY && values / 1_000 > samples {
        let period_secs = data.period_secs.unwrap_or_default();
        return Err(DataError::TooFine { period_secs, values, samples });
    }
    Ok(())
}

/// Wells and plants that were logged at the same time are not one log, however similar their channels are.
fn refuse_mixed_partitions(
    files: &[LogFile],
    irregularities: &Irregularities,
) -> Result<(), DataError> {
    for &(first, second) in &irregularities.overlaps {
        refuse_pair(&files[first].source, &files[second].source, &|_| true)?;
    }
    Ok(())
}

/// Returns the union of the files' columns, in order of appearance.
fn list_channels(files: &[LogFile], times: &[usize], file_as_prefix: bool) -> Vec<Channel> {
    let prefixes = if file_as_prefix {
        prefixes(&files.iter().map(LogFile::path).collect::<Vec<_>>())
    } else {
        vec![String::new(); files.len()]
    };
    let mut channels: Vec<Channel> = Vec::new();
    let mut known: HashMap<String, usize> = HashMap::new();
    for (file, (log_file, &time)) in files.iter().zip(times).enumerate() {
        for (position, field) in log_file.fields.iter().enumerate() {
            if position == time || log_file.no_channels.contains(&position) {
                continue;
            }
            let name = format!("{}{}", prefixes[file], field.name);
            let index = *known.entry(name.clone()).or_insert_with(|| {
                channels.push(Channel {
                    name,
                    type_name: field.type_name.clone(),
                    description: field.description.clone(),
                    readable: false,
                    angle: None,
                    column: channels.len(),
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
