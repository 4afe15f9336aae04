//! The first pass over the values: describes every channel, and decides which channels and rows are kept.

use std::{
    borrow::Cow,
    collections::BTreeMap,
    ops::Range,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
};

use calib_core::{Bounds, Monitor, Period, Timestamp, locked};
use rayon::prelude::*;

use crate::{
    AngleOf, ChannelProfile, ContradictionsFound, DataConfig, DataError, DropReason, FarOut,
    Fences, PartProfile, PreprocessConfig, Profile, UnitChange, ValueProfile,
    channel::{Moments, Movement, is_same},
    describe::describe_rows,
    doubts::ELSEWHERE,
    impute::{clean, impute},
    log::{
        Batch, Channel, ChannelValues, Contradicting, EXAMPLES, Log, Neighbourhood, SparseValues,
    },
    modes::Modes,
    names::Names,
    sample::Samples,
    select::fit,
    sentinels::{Extremes, sentinels},
    switches_read::{read_as_switches, switches_in},
};

/// The result of the first pass: everything but the values.
pub(crate) struct Survey {
    pub(crate) log: Log,
    pub(crate) stretches: Vec<Range<usize>>,
    pub(crate) profile: Profile,
    /// Kept channels, in order.
    pub(crate) sensors: Vec<Sensor>,
    pub(crate) modes: Option<Modes>,
    /// The training rows that are not dropped.
    pub(crate) train: RangeSamples,
    pub(crate) held_out: Option<RangeSamples>,
}

/// A channel that is a column of the states.
pub(crate) struct Sensor {
    pub(crate) channel: usize,
    pub(crate) bounds: Bounds,
    pub(crate) fences: Option<Fences>,
}

pub(crate) struct RangeSamples {
    pub(crate) runs: Vec<Range<usize>>,
    pub(crate) samples: Samples,
}

impl Survey {
    pub(crate) fn new(
        data: &DataConfig,
        preprocess: &PreprocessConfig,
        monitor: &dyn Monitor,
    ) -> Result<Self, DataError> {
        preprocess.check()?;
        let log = Log::open(data, monitor)?;
        Names::new(&data.include).check(log.channels.iter().flat_map(Channel::names))?;
        let unused_excludes = log.unused_excludes(data);
        let stretches = log.stretches();
        let modes = Modes::read(&log, preprocess, monitor)?;
        let scan = Scan {
            preprocess,
            stretches: &stretches,
            dropped_rows: flags(log.rows.timestamps.len()),
            conflicts: flags(log.recorded().duplicates.len()),
            contradictions: Mutex::default(),
            log: &log,
        };
        let Scanned { channels, sensors, extremes, switches } =
            scan.channels(data, modes.as_ref(), monitor)?;
        for &row in modes.iter().flat_map(|modes| &modes.left) {
            scan.dropped_rows[row].store(true, Relaxed);
        }
        let conflicting = count(&scan.conflicts);
        let contradictions =
            scan.contradictions.into_inner().unwrap_or_else(PoisonError::into_inner);
        let dropped = scan.dropped_rows;
        let part = |rows: &Range<usize>| -> Result<(RangeSamples, PartProfile), DataError> {
            let inside = crate::log::inside(&stretches, rows);
            let runs = clean(&inside, |row| dropped[row].load(Relaxed));
            let samples =
                Samples::of(&runs, preprocess.subsample, preprocess.reduce).map_err(|_| {
                    DataError::TooManyRows {
                        rows: log.rows.timestamps.len() as u64,
                        resampled: data.resample.is_some(),
                    }
                })?;
            let profile = PartProfile {
                start: log.rows.timestamps[rows.start],
                end: log.rows.timestamps[rows.end - 1],
                log_rows: rows.len() as u64,
                dropped_rows: count(&dropped[rows.clone()]),
                rows: samples.rows() as u64,
                segments: samples.segments.len() as u64,
                transitions: samples.transitions() as u64,
            };
            Ok((RangeSamples { runs, samples }, profile))
        };
        let (train, train_profile) = part(&log.train)?;
        let (held_out, held_out_profile) = log.held_out.as_ref().map(part).transpose()?.unzip();
        let mut described = describe_rows(&log, conflicting);
        described.read_as.extend(read_as_switches(&switches));
        let columns = sensors.len() * (1 + preprocess.traces.len())
            + if preprocess.time_of_day { 2 } else { 0 }
            + modes.as_ref().map_or(0, |modes| modes.labels.len());
        let rows = train_profile.rows + held_out_profile.as_ref().map_or(0, |part| part.rows);
        let profile = Profile {
            channels,
            unused_excludes,
            columns,
            state_bytes: rows * columns as u64 * size_of::<f32>() as u64,
            sampled_period_secs: sampled_period(log.period, preprocess).as_secs(),
            train: train_profile,
            held_out: held_out_profile,
            unseen_modes: unseen_modes(&log, modes.as_ref()),
            sentinels: sentinels(&log.by_recorded_name(&extremes)),
            contradictions: contradictions_found(&log, contradictions, monitor)?,
            ..described
        };
        Ok(Self { log, stretches, profile, sensors, modes, train, held_out })
    }
}

pub(crate) fn sampled_period(period: Period, preprocess: &PreprocessConfig) -> Period {
    let every = i64::try_from(preprocess.subsample).unwrap_or(i64::MAX);
    Period::from_micros(period.as_micros().saturating_mul(every)).unwrap_or(period)
}

/// The state that all channels of a scan share.
struct Scan<'a> {
    log: &'a Log,
    preprocess: &'a PreprocessConfig,
    stretches: &'a [Range<usize>],
    /// Rows that miss a value of a kept channel.
    dropped_rows: Vec<AtomicBool>,
    /// Duplicates that contradict the kept row.
    conflicts: Vec<AtomicBool>,
    /// Contradictions, by channel.
    contradictions: Mutex<BTreeMap<usize, Contradicting>>,
}

struct Scanned {
    /// Profiles of all channels.
    channels: Vec<ChannelProfile>,
    /// The kept channels.
    sensors: Vec<Sensor>,
    /// The extreme values of the channels that were read, with the channels' positions.
    extremes: Vec<(usize, Extremes)>,
    /// The channels that are pairs of words, each with its words.
    switches: Vec<String>,
}

/// Returns the contradictions of a log, and their cause.
fn contradictions_found(
    log: &Log,
    found: BTreeMap<usize, Contradicting>,
    monitor: &dyn Monitor,
) -> Result<ContradictionsFound, DataError> {
    let found: Vec<(usize, Contradicting)> = found.into_iter().collect();
    let found = log.contradictions_of(&found);
    let cause = if found.count > 0 { log.cause_of_contradictions(monitor)? } else { None };
    Ok(ContradictionsFound { cause, ..found })
}

impl Scan<'_> {
    fn channels(
        &self,
        data: &DataConfig,
        modes: Option<&Modes>,
        monitor: &dyn Monitor,
    ) -> Result<Scanned, DataError> {
        let include = Names::new(&data.include);
        let exclude = Names::new(&data.exclude);
        let mut profiles: Vec<ChannelProfile> = Vec::new();
        let mut to_read = Vec::new();
        for (index, channel) in self.log.channels.iter().enumerate() {
            let dropped = if let Some(modes) = modes.filter(|modes| modes.channel == index) {
                Some(DropReason::OneHot { columns: modes.columns(&channel.name).collect() })
            } else if let Some(pattern) = exclude.matching_any(channel.names()) {
                let pattern = pattern.to_owned();
                Some(DropReason::Excluded { pattern })
            } else if !data.include.is_empty() && include.matching_any(channel.names()).is_none() {
                Some(DropReason::NotIncluded)
            } else if channel.readable {
                to_read.push(index);
                None
            } else {
                let type_name = channel.type_name.clone();
                Some(DropReason::WrongType { type_name })
            };
            profiles.push(unread(channel, dropped));
        }
        if let Some(modes) = modes {
            profiles[modes.channel].imputed = modes.imputed;
            profiles[modes.channel].unfilled = modes.left.len() as u64;
        }
        let mut sensors = Vec::new();
        let mut extremes = Vec::new();
        let mut switches = Vec::new();
        let mut batch = Batch::default();
        monitor.begin("inspecting channels", to_read.len() as u64);
        for channels in to_read.chunks(self.log.batch_size()) {
            let values = self.log.read_sparse(channels, &mut batch, monitor)?;
            let ends =
                channels.iter().zip(&*values).map(|(at, values)| (*at, values.extremes.clone()));
            extremes.extend(ends);
            switches.extend(switches_in(self.log, channels, values));
            let scanned: Vec<_> = values
                .par_iter_mut()
                .zip(channels)
                .map(|(values, &channel)| self.channel(channel, profiles[channel].clone(), values))
                .collect();
            for (&channel, (profile, bounds)) in channels.iter().zip(scanned) {
                profiles[channel] = profile;
                let fences = profiles[channel].far_out.fences;
                sensors.extend(bounds.map(|bounds| Sensor { channel, bounds, fences }));
            }
        }
        Ok(Scanned { channels: profiles, sensors, extremes, switches })
    }

    /// Returns the profile of one channel, and its bounds if it is kept.
    fn channel(
        &self,
        index: usize,
        profile: ChannelProfile,
        channel: &mut ChannelValues,
    ) -> (ChannelProfile, Option<Bounds>) {
        let log = self.log;
        for &position in &channel.conflicts {
            self.conflicts[position as usize].store(true, Relaxed);
        }
        if channel.contradictions.count > 0 {
            locked(&self.contradictions).insert(index, channel.contradictions.clone());
        }
        let has_words = !channel.not_numbers.words.is_empty();
        let sparse = channel.sparse.take();
        let (summary, bounds) =
            if let Some(sparse) = sparse.as_ref().filter(|sparse| self.misses_too_much(sparse)) {
                let mut near = sparse.with_neighbours(&log.steps.stretches);
                let summary = self.summarise(&mut ChannelView::few_rows(&mut near, self));
                let bounds = match summary.in_train {
                    Some(_) => {
                        let limit = self.preprocess.max_missing;
                        Err(DropReason::Missing { fraction: summary.missing_fraction, limit })
                    }
                    None => fit(&[], None, has_words, self.preprocess),
                };
                (summary, bounds)
            } else {
                if let Some(sparse) = sparse {
                    channel.values = sparse.into_all(log.rows.timestamps.len());
                }
                let values = &mut channel.values;
                let summary = self.summarise(&mut ChannelView::all_rows(values, self));
                let in_train = &values[log.train.clone()];
                let bounds = fit(in_train, summary.in_train, has_words, self.preprocess);
                (summary, bounds)
            };
        let switch = channel.not_numbers.switch.as_ref();
        let bounds = bounds.map_err(|reason| reason.with_word(switch));
        let mut imputed = 0;
        let mut unfilled = 0;
        if bounds.is_ok() && summary.missing > 0 {
            imputed = impute(
                &mut channel.values,
                &log.rows.timestamps,
                self.stretches,
                self.preprocess.missing,
                self.preprocess.fill_limit,
                |row| {
                    unfilled += 1;
                    self.dropped_rows[row].store(true, Relaxed);
                },
            );
        }
        let angle =
            profile.angle.map(|angle| AngleOf { recorded: channel.extremes.range(), ..angle });
        let profile = ChannelProfile {
            angle,
            dropped: bounds.as_ref().err().cloned(),
            values: summary.profile,
            missing: summary.missing as u64,
            missing_fraction: summary.missing_fraction,
            non_finite: channel.not_numbers.non_finite,
            stood_for_missing: channel.stood_for_missing,
            words: channel.not_numbers.by_frequency().into_iter().take(EXAMPLES).collect(),
            far_out: summary.far_out,
            unit_change: summary.unit_change,
            bridged: channel.bridged.clone(),
            imputed,
            unfilled,
            ..profile
        };
        (profile, bounds.ok())
    }

    /// Whether a channel misses so many values in the training range that it is dropped.
    fn misses_too_much(&self, sparse: &SparseValues) -> bool {
        let train = &self.log.train;
        let missing = 1.0 - sparse.count(train) as f64 / train.len() as f64;
        missing > self.preprocess.max_missing
    }

    /// Summarises the values; spikes are treated as configured.
    fn summarise(&self, view: &mut ChannelView<'_>) -> ValueSummary {
        let movement = Movement::of(view.values, &view.timestamps, &view.stretches);
        let mut far_out = self.treat_spikes(view, movement.smallest_change);
        let ChannelView { values, timestamps, train, held_out, .. } = view;
        let in_train = Moments::of(&values[train.clone()]);
        let around = [Moments::of(&values[..train.start]), Moments::of(&values[train.end..])];
        let moments = around.into_iter().chain([in_train]).flatten().reduce(Moments::merge);
        let present = moments.map_or(0, |moments| moments.count);
        let present_in_train = in_train.map_or(0, |moments| moments.count);
        if let (Some(moments), Some(held_out)) = (in_train, held_out) {
            note_held_out(&values[held_out.clone()], moments, &mut far_out);
        }
        ValueSummary {
            unit_change: UnitChange::find(&values[train.clone()], &timestamps[train.clone()]),
            in_train,
            missing: self.log.rows.timestamps.len() - present,
            missing_fraction: 1.0 - present_in_train as f64 / self.log.train.len() as f64,
            profile: moments.map(|moments| ValueProfile {
                min: moments.min,
                max: moments.max,
                mean: moments.mean,
                std: moments.std(),
                constant: is_same(moments.min, moments.max),
                longest_stuck_secs: movement.longest_stuck as f64 / 1e6,
                stuck_at: movement.stuck_at,
                smallest_change: movement.smallest_change,
                unchanged: movement.unchanged,
                distinct: movement.distinct,
            }),
            far_out,
        }
    }

    /// Finds the spikes of a channel, and treats them as configured.
    fn treat_spikes(&self, view: &mut ChannelView<'_>, smallest_change: Option<f64>) -> FarOut {
        let ChannelView { values, timestamps, cut, train, .. } = view;
        let mut found = FarOut::default();
        let Some(fences) = Fences::of(&values[train.clone()], smallest_change) else {
            return found;
        };
        found.fences = Some(fences);
        fences.spikes(values, cut, |row| {
            found.spikes += 1;
            if found.examples.len() < EXAMPLES {
                found.examples.push((timestamps[row], values[row]));
            }
        });
        if found.spikes > 0 {
            fences.treat(values, cut, self.preprocess.outliers);
        }
        found
    }
}

/// The values of a channel in all rows of the log, or only in the relevant rows of a sparse channel.
struct ChannelView<'a> {
    values: &'a mut [f64],
    timestamps: Cow<'a, [Timestamp]>,
    /// Stretches without a gap.
    stretches: Cow<'a, [Range<usize>]>,
    /// Stretches, cut at the ends of the ranges.
    cut: Cow<'a, [Range<usize>]>,
    train: Range<usize>,
    held_out: Option<Range<usize>>,
}

impl<'a> ChannelView<'a> {
    fn all_rows(values: &'a mut [f64], scan: &Scan<'a>) -> Self {
        let log = scan.log;
        Self {
            values,
            timestamps: Cow::Borrowed(&log.rows.timestamps),
            stretches: Cow::Borrowed(&log.steps.stretches),
            cut: Cow::Borrowed(scan.stretches),
            train: log.train.clone(),
            held_out: log.held_out.clone(),
        }
    }

    fn few_rows(near: &'a mut Neighbourhood, scan: &Scan<'a>) -> Self {
        let log = scan.log;
        let train = near.positions(&log.train);
        let held_out = log.held_out.as_ref().map(|rows| near.positions(rows));
        Self {
            timestamps: near.rows.iter().map(|&row| log.rows.timestamps[row]).collect(),
            cut: crate::log::inside_both(&near.stretches, &train, held_out.as_ref()).into(),
            stretches: Cow::Borrowed(&near.stretches),
            values: &mut near.values,
            train,
            held_out,
        }
    }
}

/// Summary of the values of a channel.
struct ValueSummary {
    in_train: Option<Moments>,
    missing: usize,
    missing_fraction: f64,
    profile: Option<ValueProfile>,
    far_out: FarOut,
    unit_change: Option<UnitChange>,
}

/// Counts the values that lie further from the training range than it is wide. If the range has no width, it
/// counts all other values.
fn note_held_out(values: &[f64], train: Moments, found: &mut FarOut) {
    let width = train.max - train.min;
    if is_same(train.min, train.max) {
        let others = values.iter().filter(|value| !value.is_nan() && !is_same(**value, train.min));
        found.held_out = others.count() as u64;
        return;
    }
    for &value in values {
        let beyond = if value < train.min {
            (value - train.min) / width
        } else {
            ((value - train.max) / width).max(0.0)
        };
        if beyond.abs() > 1.0 {
            found.held_out += 1;
            found.elsewhere += u64::from(beyond.abs() > ELSEWHERE);
            found.trained = Some([train.min, train.max]);
            if beyond.abs() > found.furthest.abs() {
                found.furthest = beyond;
            }
        }
    }
}

/// Returns the profile of a channel whose values were not read.
fn unread(channel: &Channel, dropped: Option<DropReason>) -> ChannelProfile {
    ChannelProfile {
        name: channel.name.clone(),
        type_name: channel.type_name.clone(),
        angle: channel.angle.clone(),
        description: channel.description.clone(),
        dropped,
        ..ChannelProfile::default()
    }
}

fn flags(count: usize) -> Vec<AtomicBool> {
    (0..count).map(|_| AtomicBool::new(false)).collect()
}

fn count(flags: &[AtomicBool]) -> u64 {
    flags.iter().filter(|flag| flag.load(Relaxed)).count() as u64
}

fn unseen_modes(log: &Log, modes: Option<&Modes>) -> u64 {
    match (modes, &log.held_out) {
        (Some(modes), Some(rows)) => {
            rows.clone().filter(|&row| modes.is_unseen(row)).count() as u64
        }
        _ => 0,
    }
}
