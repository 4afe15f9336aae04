//! The log in its files: rows in time order, channels, ranges.

mod alike_names;
mod angles;
mod assemble;
mod bad_rows;
mod cause;
mod clock;
mod clock_resets;
mod column_aliases;
mod column_pairs;
mod columns;
mod dedup;
mod entries;
mod export_pairs;
mod file;
mod filename_tag;
mod gaps;
mod head;
mod long;
mod max_ages;
mod memory_limit;
mod open;
mod read;
mod resample;
mod rows;
mod series;
mod shape;
mod shared_times;
mod side_labels;
mod source;
mod sparse;
mod split;
mod tag_words;
mod times;
mod union;
mod values;

use std::{
    collections::{BTreeMap, HashMap, HashSet},
    ops::Range,
    path::PathBuf,
};

use calib_core::{Monitor, Period, Timestamp};
use calib_text::format_time;

pub use self::{bad_rows::BadRowsFound, cause::ContradictionCause, source::text_left_alone};
pub(crate) use self::{
    column_aliases::{TAGS, plain},
    dedup::Contradicting,
    file::{FieldKind, classify},
    gaps::{Steps, detect_period, inside, inside_both, interval},
    memory_limit::MemoryLimit,
    read::{Batch, ChannelValues, Codes},
    rows::EXAMPLES,
    sparse::{Neighbourhood, SparseValues},
};
use self::{dedup::SHOWN, file::LogFile, resample::Grid, rows::Rows, series::Series, split::Split};
use crate::{
    AngleOf, BackwardStep, BackwardSteps, Contradictions, ContradictionsFound, DataConfig,
    DataError, Description, Shape,
    names::{Chosen, Names},
};

/// Everything about the log except the values of its channels.
pub(crate) struct Log {
    pub(crate) files: Vec<FileSummary>,
    pub(crate) shape: Shape,
    origin: Origin,
    pub(crate) rows: Rows,
    /// The rows as recorded, if they differ from those of the log.
    recorded: Option<Rows>,
    grid: Option<Grid>,
    /// How long the values of each channel stay valid in rows of the grid, in microseconds; empty without a grid.
    max_ages: Vec<i64>,
    /// Treatment of contradictions.
    pub(crate) contradictions: Contradictions,
    /// Numbers that stand for a missing value.
    missing_values: Vec<f64>,
    /// Whether times are UTC rather than local wall-clock times.
    pub(crate) utc: bool,
    /// Lines of text files that were skipped because they cannot be read.
    pub(crate) bad_rows: BadRowsFound,
    /// Whether rows have no times, so that they are numbered.
    pub(crate) without_times: bool,
    /// Sentences about columns that are not read independently, such as joined times.
    pub(crate) read_as: Vec<String>,
    /// Number of samples that are missing because of their quality.
    pub(crate) bad_quality: u64,
    /// Number of rows without a time because it names no instant, or two that no other row can tell apart.
    pub(crate) undecided: u64,
    pub(crate) channels: Vec<Channel>,
    pub(crate) period: Period,
    pub(crate) period_was_detected: bool,
    pub(crate) steps: Steps,
    pub(crate) train: Range<usize>,
    pub(crate) held_out: Option<Range<usize>>,
}

#[derive(Clone, Debug)]
pub(crate) struct FileSummary {
    pub(crate) path: PathBuf,
    pub(crate) bytes: u64,
    pub(crate) rows: usize,
}

/// The source of the channels.
#[expect(clippy::large_enum_variant, reason = "there is one for a log")]
enum Origin {
    /// Wide files.
    Tables(Vec<LogFile>),
    /// Samples by tag, and the instants between which they count.
    Series(Series, Range<i64>),
}

/// A column of the files that is not the timestamp.
#[derive(Clone, Debug)]
pub(crate) struct Channel {
    pub(crate) name: String,
    /// The types, in order of appearance; more than one if files disagree.
    pub(crate) type_name: String,
    pub(crate) description: Description,
    /// Whether at least one file has the channel as numbers or text.
    pub(crate) readable: bool,
    /// The angle, if the channel is its sine or cosine.
    pub(crate) angle: Option<AngleOf>,
    /// Index among the columns or tags of the log. The two channels of an angle share it.
    column: usize,
    /// Column position in each file in which the channel is readable.
    positions: HashMap<usize, usize>,
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

    /// Whether the rows are those of a clock on which all channels are put.
    pub(crate) fn is_resampled(&self) -> bool {
        self.grid.is_some()
    }

    /// Returns the entries of `data.exclude` that match no channel.
    pub(crate) fn unused_excludes(&self, data: &DataConfig) -> Vec<String> {
        let names = self.channels.iter().flat_map(Channel::names);
        let unused = Names::new(&data.exclude).unused(&names).into_iter().map(str::to_owned);
        unused.collect()
    }

    /// Returns the chosen channels of neither numbers nor text, with their types.
    pub(crate) fn unreadable(&self, data: &DataConfig) -> BTreeMap<String, String> {
        let chosen = Chosen::of(data);
        let missed = self
            .channels
            .iter()
            .filter(|channel| !channel.readable && chosen.has(&channel.names()));
        missed.map(|channel| (channel.name.clone(), channel.type_name.clone())).collect()
    }

    /// Returns findings about some channels, by the channel names in the files. Of the two channels of an angle only
    /// the first counts, because both have the findings of the recorded angles.
    pub(crate) fn by_recorded_name<'a, T>(
        &'a self,
        found: &'a [(usize, T)],
    ) -> Vec<(&'a str, &'a T)> {
        let mut named = Vec::with_capacity(found.len());
        let mut columns = HashSet::new();
        for (channel, item) in found {
            let channel = &self.channels[*channel];
            if columns.insert(channel.column) {
                named.push((channel.recorded_name(), item));
            }
        }
        named
    }

    /// Returns the contradictions of some channels, without their cause.
    pub(crate) fn contradictions_of(
        &self,
        found: &[(usize, Contradicting)],
    ) -> ContradictionsFound {
        let named = self.by_recorded_name(found);
        let counts = named.iter().map(|(_, found)| found.count);
        ContradictionsFound {
            count: counts.clone().sum(),
            most_of_channel: counts.max().unwrap_or(0),
            examples: named
                .iter()
                .flat_map(|(name, found)| -> Vec<String> {
                    found.first.iter().map(|contradiction| contradiction.told(name)).collect()
                })
                .take(SHOWN)
                .collect(),
            cause: None,
        }
    }

    /// Rejects contradictions in some channels, unless the study selects one of the values.
    pub(crate) fn refuse_contradictions(
        &self,
        found: &[(usize, Contradicting)],
        monitor: &dyn Monitor,
    ) -> Result<(), DataError> {
        let ContradictionsFound { count, examples, .. } = self.contradictions_of(found);
        if count == 0 || !self.contradictions.refuses() {
            return Ok(());
        }
        let cause = self.cause_of_contradictions(monitor)?;
        Err(DataError::Contradictions { count, examples, cause })
    }

    pub(crate) fn backward_steps(&self) -> BackwardSteps {
        let irregular = &self.recorded().irregularities;
        BackwardSteps {
            count: irregular.backward_steps,
            examples: irregular
                .first_backward_steps
                .iter()
                .map(|&(file, from, to): &(usize, Timestamp, Timestamp)| BackwardStep {
                    file: self.files[file].path.display().to_string(),
                    from,
                    to,
                })
                .collect(),
        }
    }

    pub(crate) fn recorded(&self) -> &Rows {
        self.recorded.as_ref().unwrap_or(&self.rows)
    }

    /// Returns the median step in seconds, if it contradicts the period in the study: nearly all steps of the training
    /// range have this length, or most steps of the log are gaps.
    pub(crate) fn recorded_period_secs(&self) -> Option<f64> {
        if self.period_was_detected || self.grid.is_some() {
            return None;
        }
        let steps = self.rows.timestamps.len().saturating_sub(1) as u64;
        let recorded = match self.other_interval() {
            None if 2 * self.steps.gaps > steps => detect_period(&self.rows.timestamps),
            interval => interval,
        };
        recorded.map(Period::as_secs)
    }

    /// Returns the recording interval of the training range, if it differs from the period.
    pub(crate) fn other_interval(&self) -> Option<Period> {
        let interval = interval(&self.rows.timestamps[self.train.clone()]);
        interval.filter(|interval| !gaps::are_alike(self.period, *interval))
    }

    /// Returns stretches without a gap, cut at the ends of the two ranges; rows outside both are excluded.
    pub(crate) fn stretches(&self) -> Vec<Range<usize>> {
        inside_both(&self.steps.stretches, &self.train, self.held_out.as_ref())
    }
}

fn row_ranges(
    data: &DataConfig,
    split: &Split,
    timestamps: &[Timestamp],
    (first, last): (i64, i64),
) -> Result<(Range<usize>, Option<Range<usize>>), DataError> {
    let rows = |key, configured: Option<String>, range: &Range<i64>| {
        let rows = split::rows_in(timestamps, range);
        if rows.is_empty() {
            let range = configured.unwrap_or_default();
            let [start, end] =
                [first, last].map(|micros| format_time(Timestamp::from_micros(micros)));
            return Err(DataError::OutsideData { key, range, start, end });
        }
        Ok(rows)
    };
    let train = rows("train", data.train.as_ref().map(ToString::to_string), &split.train)?;
    let configured = data.held_out.as_ref().map(ToString::to_string);
    let held_out =
        split.held_out.as_ref().map(|range| rows("held_out", configured, range)).transpose()?;
    Ok((train, held_out))
}

/// Returns the files that `data` selects, in order of their names. They are not read. Some may turn out to be results
/// of calib, which are not logs.
///
/// # Errors
/// If a pattern selects nothing, or a folder cannot be read.
pub fn log_files(data: &DataConfig) -> Result<Vec<PathBuf>, DataError> {
    Ok(source::find_files(data)?.into_iter().map(|source| source.path).collect())
}

/// Size of a log according to its footers, before it is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Declared {
    /// Rows of all files; an estimate for text files, which do not declare it.
    pub rows: u64,
    /// Minimum memory for reading, in bytes, without the states.
    pub least_bytes: u64,
}

impl Declared {
    /// Reads the footers of the files that `data` names.
    ///
    /// # Errors
    /// If there are no files, or one cannot be read.
    pub fn of(data: &DataConfig) -> Result<Self, DataError> {
        let mut rows = 0_u64;
        for source in source::without_empty(source::find_files(data)?)?.0 {
            rows += match head::Head::open(source, data)? {
                head::Head::Parquet(file) if file.is_result => 0,
                head::Head::Parquet(file) => file.rows as u64,
                head::Head::Text(file) => file.estimated_rows(),
                head::Head::Annotated(..) => 0,
            };
        }
        Ok(Self { rows, least_bytes: rows.saturating_mul(BYTES_PER_ROW) })
    }
}

/// Per row: the timestamp as read and in order, and at least two channels that are read together, each as in the file
/// and as numbers.
const BYTES_PER_ROW: u64 = 8 + 8 + 2 * (8 + 8);
