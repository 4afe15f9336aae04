//! The log: rows in time order, channels, ranges.

use std::{
    collections::{BTreeMap, HashMap, HashSet},
    ops::Range,
    path::PathBuf,
};

use calib_core::{Period, Timestamp};

use super::{
    bad_rows_found::BadRowsFound,
    dedup::{Contradicting, SHOWN},
    file::LogFile,
    gaps::{Steps, are_alike, detect_period, inside_both, interval},
    resample::Grid,
    rows::Rows,
    series::Series,
};
use crate::{
    AngleOf, BackwardStep, BackwardSteps, Contradictions, ContradictionsFound, DataConfig,
    Description, Shape,
    names::{Chosen, Names},
};

/// Everything about the log except the values of its channels.
pub(crate) struct Log {
    pub(crate) files: Vec<FileSummary>,
    pub(crate) shape: Shape,
    pub(super) origin: Origin,
    pub(crate) rows: Rows,
    /// The rows as recorded, if they differ from those of the log.
    pub(super) recorded: Option<Rows>,
    pub(super) grid: Option<Grid>,
    /// How long the values of each channel stay valid in rows of the grid, in microseconds; empty without a grid.
    pub(super) max_ages: Vec<i64>,
    /// Treatment of contradictions.
    pub(crate) contradictions: Contradictions,
    /// Numbers that stand for a missing value.
    pub(super) missing_values: Vec<f64>,
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
pub(super) enum Origin {
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
    pub(super) column: usize,
    /// Column position in each file in which the channel is readable.
    pub(super) positions: HashMap<usize, usize>,
}

impl Log {
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
        interval.filter(|interval| !are_alike(self.period, *interval))
    }

    /// Returns stretches without a gap, cut at the ends of the two ranges; rows outside both are excluded.
    pub(crate) fn stretches(&self) -> Vec<Range<usize>> {
        inside_both(&self.steps.stretches, &self.train, self.held_out.as_ref())
    }
}
