//! The log as it lies in its files: rows in time order, channels, ranges.

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
    /// The rows as they were recorded, where those of the log are others.
    recorded: Option<Rows>,
    grid: Option<Grid>,
    /// How long the values of each channel stand in rows of the grid, in microseconds; nothing without a grid.
    max_ages: Vec<i64>,
    /// What happens to contradictions.
    pub(crate) contradictions: Contradictions,
    /// Numbers that stand for a missing value.
    missing_values: Vec<f64>,
    /// Whether times are UTC rather than what some clock showed.
    pub(crate) utc: bool,
    /// Lines of text files that were left out because they cannot be read.
    pub(crate) bad_rows: BadRowsFound,
    /// Whether rows have no times but their numbers.
    pub(crate) without_times: bool,
    /// How columns are read otherwise than each by itself, in sentences.
    pub(crate) read_as: Vec<String>,
    /// Samples that their quality made missing.
    pub(crate) bad_quality: u64,
    /// Rows without a time because theirs names no instant, or two between which nothing decides.
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

/// Where channels are read from.
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
    /// Its types, in order of appearance; more than one if files disagree.
    pub(crate) type_name: String,
    pub(crate) description: Description,
    /// Whether a file has it as numbers or text.
    pub(crate) readable: bool,
    /// The angle of which it is the sine or the cosine, if it is.
    pub(crate) angle: Option<AngleOf>,
    /// Its number among the columns or the tags of the log: the two channels of an angle have one.
    column: usize,
    /// Its position in each file that has it readable.
    positions: HashMap<usize, usize>,
}

impl Log {
    pub(crate) fn open(data: &DataConfig, monitor: &dyn Monitor) -> Result<Self, DataError> {
        data.check()?;
        let (opened, utc) = open::open(data, monitor)?;
        opened.into_log(utc, data)
    }

    /// The whole log, whatever its ranges, and the channels of it that can be read and are neither excluded nor left out.
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

    /// Whether the rows are those of a clock that all channels are put on.
    pub(crate) fn is_resampled(&self) -> bool {
        self.grid.is_some()
    }

    /// Entries of `data.exclude` that match no channel.
    pub(crate) fn unused_excludes(&self, data: &DataConfig) -> Vec<String> {
        let names = self.channels.iter().flat_map(Channel::names);
        let unused = Names::new(&data.exclude).unused(&names).into_iter().map(str::to_owned);
        unused.collect()
    }

    /// The channels of neither numbers nor text that the study does not leave out, with their types.
    pub(crate) fn unreadable(&self, data: &DataConfig) -> BTreeMap<String, String> {
        let chosen = Chosen::of(data);
        let missed = self
            .channels
            .iter()
            .filter(|channel| !channel.readable && chosen.has(&channel.names()));
        missed.map(|channel| (channel.name.clone(), channel.type_name.clone())).collect()
    }

    /// What was found in some channels, by the names that the files have: of the two channels of an angle the first counts, because
    /// what is found in recorded angles is found in both.
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

    /// The contradictions of some channels, without their cause.
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

    /// Refuse what contradicts itself in some channels, unless the study says which counts.
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

    /// The median step in seconds, where it is not the period that the study gives: nearly all steps of the training range are as long,
    /// or most of the log are gaps.
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

    /// The interval at which the training range was recorded, where it is not the period.
    pub(crate) fn other_interval(&self) -> Option<Period> {
        let interval = interval(&self.rows.timestamps[self.train.clone()]);
        interval.filter(|interval| !gaps::are_alike(self.period, *interval))
    }

    /// Stretches without a gap, cut at the ends of the two ranges; rows outside both are left out.
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
    /// Rows of all files; of text files, which do not say, about as many as there are.
    pub rows: u64,
    /// Memory that reading takes at the least, in bytes: the states come on top of it.
    pub least_bytes: u64,
}

impl Declared {
    /// Read the footers of the files that `data` names.
    ///
    /// # Errors
    /// If there are none, or one cannot be read.
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

/// Per row: the timestamp as it is read and in order, and two channels at least that are read together, each as the file
/// has it and as numbers.
const BYTES_PER_ROW: u64 = 8 + 8 + 2 * (8 + 8);
