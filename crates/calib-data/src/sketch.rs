//! Describes a whole log, to help choose how to read it: [`Sketch`].

use std::ops::Range;

use calib_core::{Monitor, Period, Timestamp};
use rayon::prelude::*;

use crate::{
    AngleOf, BackwardSteps, BadRowsFound, BridgedStops, ContradictionsFound, DataConfig, DataError,
    Sentinel, Shape, ShownClock, UnitChange,
    channel::{Moments, Movement, is_same},
    log::{Batch, Channel, ChannelValues, Contradicting, Log, SparseValues, detect_period},
    outliers::Fences,
    sentinels::{Extremes, sentinels},
    switches_read::{read_as_switches, switches_in},
};

mod counting;

pub use counting::{FEW_VALUES, counts_on_evenly};

/// Maximum number of bins of a log.
const BINS: usize = 64;
/// Maximum number of values per channel that are kept for comparisons with other channels; fewer if there are very many
/// channels.
const THINNED: usize = 4_000;
/// Maximum number of kept values of all channels, and minimum number per channel.
const ALL_THINNED: usize = 32 << 20;
const LEAST_THINNED: usize = 250;
/// Lags, in rows, for the autocorrelation.
const LAGS: [usize; 19] =
    [1, 2, 3, 5, 10, 15, 20, 30, 60, 100, 150, 200, 300, 600, 1_000, 2_000, 3_000, 6_000, 10_000];

/// A description of a whole log: where channels have values, how they change, and which ones do not look like sensors.
#[derive(Clone, Debug)]
pub struct Sketch {
    /// What a row of the files is.
    pub shape: Shape,
    /// Whether rows have no times, so that they are numbered.
    pub without_times: bool,
    /// Sentences about columns that are not read independently, such as joined times.
    pub read_as: Vec<String>,
    /// Number of files.
    pub files: usize,
    /// Lines of text files that were skipped.
    pub bad_rows: BadRowsFound,
    /// Whether times are UTC.
    pub utc: bool,
    /// The clock that people read its times on.
    pub clock: ShownClock,
    /// The median step, or the period that was given, in seconds.
    pub period_secs: f64,
    /// The median step in seconds, if it contradicts the given period: nearly all steps have this length, or most are
    /// gaps.
    pub recorded_period_secs: Option<f64>,
    /// Steps back in time inside a file.
    pub backward_steps: BackwardSteps,
    /// Whether the rows are those of a clock on which `data.resample` puts all channels.
    pub resampled: bool,
    /// Time of each row.
    pub timestamps: Vec<Timestamp>,
    /// Bins with equal numbers of rows.
    pub bins: Vec<Range<usize>>,
    /// Entries of `data.exclude` that match no channel.
    pub unused_excludes: Vec<String>,
    /// Numbers that probably stand for a missing value.
    pub sentinels: Vec<Sentinel>,
    /// The channels that hold numbers, in the order of the files.
    pub channels: Vec<ChannelSketch>,
}

/// One channel of a [`Sketch`].
#[derive(Clone, Debug)]
pub struct ChannelSketch {
    /// Name of the channel.
    pub name: String,
    /// The angle, if the channel is its sine or cosine.
    pub angle: Option<AngleOf>,
    /// The most frequent text in the channel that is not a number; `None` without text.
    pub text: Option<String>,
    /// Share of the rows with a value, per bin.
    pub present: Vec<f64>,
    /// Whether the channel changes within each bin, not counting spikes.
    pub moves: Vec<bool>,
    /// Number of distinct values, if there are at most 256.
    pub distinct: Option<u32>,
    /// Smallest and largest value, not counting spikes; `None` without a value.
    pub range: Option<[f64; 2]>,
    /// Share of the changes that go up.
    pub rises: f64,
    /// Share of the changes that have the usual size.
    pub even: f64,
    /// Whether nearly all changes go up, and all others far down: a total that restarts.
    pub restarts: bool,
    /// A full turn, if the channel is an angle: its values fill the turn, and wrap around at its ends.
    pub wraps: Option<f64>,
    /// Share of successive rows without a change.
    pub unchanged: f64,
    /// Longest time without any change, in seconds.
    pub longest_stuck_secs: f64,
    /// The value of that time.
    pub stuck_at: Option<f64>,
    /// Autocorrelation at each of these lags, in rows: `1 - mean((x[i + lag] - x[i])²) / (2 variance)`, from rows of
    /// the same stretch without a gap (Matheron's variogram, 1963: gaps do not disturb it). Empty for a constant.
    pub autocorrelation: Vec<(usize, f64)>,
    /// Number of spikes.
    pub spikes: u64,
    /// A time at which the unit probably changed.
    pub unit_change: Option<UnitChange>,
    /// Number of values that another one at the same time contradicts.
    pub contradicting: u64,
    /// Recording stops that the last value bridged, under `data.resample`.
    pub bridged: BridgedStops,
    /// Values at evenly spaced rows, NaN where missing; all channels have the same rows.
    pub thinned: Vec<f64>,
    /// The 95 % quantile of the lengths of runs of missing values, in rows; 0 without such runs.
    pub missing_run: usize,
    /// Median time between successive values, in seconds.
    pub own_period_secs: Option<f64>,
}

/// Describes the whole log, regardless of its ranges.
///
/// # Errors
/// If the log cannot be read or contradicts itself.
pub fn sketch(data: &DataConfig, monitor: &dyn Monitor) -> Result<Sketch, DataError> {
    let (log, wanted) = Log::open_whole(data, monitor)?;
    let rows = log.rows.timestamps.len();
    let count = BINS.min(rows);
    let bins: Vec<Range<usize>> =
        (0..count).map(|bin| bin * rows / count..(bin + 1) * rows / count).collect();
    let thinned = (ALL_THINNED / wanted.len().max(1)).clamp(LEAST_THINNED, THINNED);
    let sketcher = Sketcher { log: &log, bins: &bins, every: rows.div_ceil(thinned).max(1) };
    let mut channels = Vec::with_capacity(wanted.len());
    let mut contradicting: Vec<(usize, Contradicting)> = Vec::new();
    let mut extremes: Vec<(usize, Extremes)> = Vec::with_capacity(wanted.len());
    let mut switches = Vec::new();
    let mut batch = Batch::default();
    monitor.begin("looking at channels", wanted.len() as u64);
    for some in wanted.chunks(log.batch_size()) {
        let read = log.read_sparse(some, &mut batch, monitor)?;
        switches.extend(switches_in(&log, some, read));
        for (&channel, values) in some.iter().zip(&*read) {
            extremes.push((channel, values.extremes.clone()));
            if values.contradictions.count > 0 {
                contradicting.push((channel, values.contradictions.clone()));
            }
        }
        let sketched = read
            .par_iter_mut()
            .zip(some)
            .map(|(values, &channel)| sketcher.channel(&log.channels[channel], values));
        channels.extend(sketched.collect::<Vec<_>>());
    }
    let found = log.contradictions_of(&contradicting);
    if found.count > 0 && log.contradictions.refuses() {
        let cause = log.cause_of_contradictions(monitor)?;
        let found = ContradictionsFound { cause, ..found };
        // Overlapping exports may differ in a few rows.
        if !found.are_few(rows as u64) {
            let ContradictionsFound { count, examples, cause, .. } = found;
            return Err(DataError::Contradictions { count, examples, cause });
        }
    }
    let sentinels = sentinels(&log.by_recorded_name(&extremes));
    let unused_excludes = log.unused_excludes(data);
    Ok(Sketch {
        unused_excludes,
        backward_steps: log.backward_steps(),
        recorded_period_secs: log.recorded_period_secs(),
        without_times: log.without_times,
        read_as: log.read_as.into_iter().chain(read_as_switches(&switches)).collect(),
        files: log.files.len(),
        bad_rows: log.bad_rows,
        shape: log.shape,
        utc: log.utc,
        clock: ShownClock::of(data, log.utc),
        period_secs: log.period.as_secs(),
        resampled: data.resample.is_some(),
        timestamps: log.rows.timestamps,
        bins,
        sentinels,
        channels,
    })
}

impl Sketch {
    /// Returns warnings about channels whose unit probably changed.
    pub fn unit_doubts(&self) -> Vec<String> {
        let changed = self.channels.iter().filter_map(|channel| {
            let change = channel.unit_change.as_ref()?;
            Some(format!("{} has {}", channel.name, change.told(&self.clock.named(change.at))))
        });
        changed.collect()
    }
}

/// The inputs that all channels share.
struct Sketcher<'a> {
    log: &'a Log,
    bins: &'a [Range<usize>],
    /// Number of rows from one kept value to the next.
    every: usize,
}

impl Sketcher<'_> {
    fn channel(&self, source: &Channel, channel: &mut ChannelValues) -> ChannelSketch {
        let text = channel.not_numbers.example();
        if let Some(sparse) = &channel.sparse {
            let sketch = self.sparse(source, sparse, channel.contradictions.count);
            return ChannelSketch { text, ..sketch };
        }
        let timestamps = &self.log.rows.timestamps;
        let stretches = &self.log.steps.stretches;
        let contradicting = channel.contradictions.count;
        let (sketch, moments) =
            moving(source, &mut channel.values, timestamps, stretches, contradicting);
        let values = &channel.values;
        let there = stretches.iter().enumerate().flat_map(|(stretch, rows)| {
            let there = rows.clone().filter(move |&row| !values[row].is_nan());
            there.map(move |row| (stretch, row))
        });
        ChannelSketch {
            text,
            present: self.bins.iter().map(|bin| present(&values[bin.clone()])).collect(),
            moves: self.bins.iter().map(|bin| moves(&values[bin.clone()])).collect(),
            autocorrelation: moments.map_or_else(Vec::new, |moments| {
                autocorrelation(values, stretches, moments.std().powi(2))
            }),
            bridged: channel.bridged.clone(),
            thinned: values.iter().step_by(self.every).copied().collect(),
            missing_run: missing_run(there),
            own_period_secs: own_period(
                (0..values.len()).filter(|&row| !values[row].is_nan()).map(|row| timestamps[row]),
            ),
            ..sketch
        }
    }

    /// Describes a channel with values in few rows, from these rows alone.
    fn sparse(&self, source: &Channel, sparse: &SparseValues, contradicting: u64) -> ChannelSketch {
        let timestamps = &self.log.rows.timestamps;
        let mut near = sparse.with_neighbours(&self.log.steps.stretches);
        let times: Vec<Timestamp> = near.rows.iter().map(|&row| timestamps[row]).collect();
        let (sketch, moments) =
            moving(source, &mut near.values, &times, &near.stretches, contradicting);
        let mut there: Vec<Sample> = Vec::with_capacity(sparse.rows.len());
        for (stretch, places) in near.stretches.iter().enumerate() {
            let samples = places.clone().filter(|&place| !near.values[place].is_nan());
            there.extend(samples.map(|place| Sample {
                stretch,
                row: near.rows[place],
                value: near.values[place],
            }));
        }
        let moves = self.bins.iter().map(|bin| {
            let values: Vec<f64> =
                samples_in(&there, bin).iter().map(|sample| sample.value).collect();
            moves(&values)
        });
        let mut thinned = vec![f64::NAN; timestamps.len().div_ceil(self.every)];
        for sample in there.iter().filter(|sample| sample.row % self.every == 0) {
            thinned[sample.row / self.every] = sample.value;
        }
        ChannelSketch {
            present: self
                .bins
                .iter()
                .map(|bin| samples_in(&there, bin).len() as f64 / bin.len().max(1) as f64)
                .collect(),
            moves: moves.collect(),
            autocorrelation: moments.map_or_else(Vec::new, |moments| {
                autocorrelation_of_samples(&there, moments.std().powi(2))
            }),
            thinned,
            missing_run: missing_run(there.iter().map(|sample| (sample.stretch, sample.row))),
            own_period_secs: own_period(there.iter().map(|sample| timestamps[sample.row])),
            ..sketch
        }
    }
}

struct Sample {
    stretch: usize,
    row: usize,
    value: f64,
}

/// Returns the samples whose rows lie in a bin.
fn samples_in<'a>(samples: &'a [Sample], bin: &Range<usize>) -> &'a [Sample] {
    let from = samples.partition_point(|sample| sample.row < bin.start);
    let to = samples.partition_point(|sample| sample.row < bin.end);
    &samples[from..to]
}

/// Returns the part of the sketch that follows from the moments and changes of the values, and the moments. It replaces
/// spikes in `values` by NaN.
fn moving(
    source: &Channel,
    values: &mut [f64],
    timestamps: &[Timestamp],
    stretches: &[Range<usize>],
    contradicting: u64,
) -> (ChannelSketch, Option<Moments>) {
    let movement = Movement::of(values, timestamps, stretches);
    let mut spikes = 0;
    if let Some(fences) = Fences::of(values, movement.smallest_change) {
        fences.spikes(values, stretches, |_| spikes += 1);
        fences.treat(values, stretches, crate::Outliers::Missing);
    }
    let moments = Moments::of(values);
    let changes = Changes::of(values, stretches, moments);
    let sketch = ChannelSketch {
        name: source.name.clone(),
        angle: source.angle.clone(),
        text: None,
        present: Vec::new(),
        moves: Vec::new(),
        distinct: movement.distinct,
        range: moments.map(|moments| [moments.min, moments.max]),
        rises: changes.rises,
        even: changes.even,
        restarts: changes.restarts,
        wraps: changes.wraps,
        unchanged: movement.unchanged,
        longest_stuck_secs: movement.longest_stuck as f64 / 1e6,
        stuck_at: movement.stuck_at,
        autocorrelation: Vec::new(),
        spikes,
        unit_change: UnitChange::find(values, timestamps),
        contradicting,
        bridged: BridgedStops::default(),
        thinned: Vec::new(),
        missing_run: 0,
        own_period_secs: None,
    };
    (sketch, moments)
}

fn present(values: &[f64]) -> f64 {
    values.iter().filter(|value| !value.is_nan()).count() as f64 / values.len().max(1) as f64
}

fn moves(values: &[f64]) -> bool {
    Moments::of(values).is_some_and(|moments| !is_same(moments.min, moments.max))
}

/// The changes of a channel from one value to the next.
struct Changes {
    rises: f64,
    even: f64,
    restarts: bool,
    wraps: Option<f64>,
}

/// A total that restarts rises in at least this share of its changes, and falls by at least half of its range in the
/// others.
const TOTAL_RISES: f64 = 0.9;
const TOTAL_FALLS: f64 = 0.5;
/// Minimum share of a turn that the values of an angle fill.
const TURN: f64 = 0.95;
/// Minimum number of jumps of more than half a turn in an angle. Most of them must be nearly a full turn.
const JUMPS: usize = 5;
const AROUND: f64 = 0.8;
/// For most jumps, the short way around is at most this many times as long as nine tenths of the other changes.
const LONGER: f64 = 2.0;
const LONG_STEPS: f64 = 0.9;

impl Changes {
    fn of(values: &[f64], stretches: &[Range<usize>], moments: Option<Moments>) -> Self {
        let mut changes: Vec<f64> = Vec::new();
        for stretch in stretches {
            let there = values[stretch.clone()].iter().copied().filter(|value| !value.is_nan());
            let there: Vec<f64> = there.collect();
            let moves = there.windows(2).filter(|pair| !is_same(pair[0], pair[1]));
            changes.extend(moves.map(|pair| pair[1] - pair[0]));
        }
        if changes.is_empty() {
            return Self { rises: 0.0, even: 0.0, restarts: false, wraps: None };
        }
        let count = changes.len() as f64;
        let rises = changes.iter().filter(|change| **change > 0.0).count() as f64 / count;
        let [low, high] = moments.map_or([0.0; 2], |moments| [moments.min, moments.max]);
        let mut falls = changes.iter().filter(|change| **change < 0.0);
        let restarts = rises >= TOTAL_RISES
            && falls.clone().count() >= 2
            && falls.all(|fall| -fall >= TOTAL_FALLS * (high - low));
        let wraps = turn([low, high]).filter(|turn| goes_around(&changes, *turn));
        let middle = changes.len() / 2;
        let median = *changes.select_nth_unstable_by(middle, f64::total_cmp).1;
        let even = changes
            .iter()
            .filter(|change| (**change - median).abs() <= 1e-6 * median.abs())
            .count() as f64
            / count;
        Self { rises, even, restarts, wraps }
    }
}

/// Whether the changes are those of an angle: most changes of more than half a turn are nearly a full turn, and the
/// short way around they are no longer than other changes. The last condition fails for a pump that is either off or
/// near its full speed of 360.
fn goes_around(changes: &[f64], turn: f64) -> bool {
    let sizes = changes.iter().map(|change| change.abs());
    let (jumps, mut steps): (Vec<f64>, Vec<f64>) = sizes.partition(|size| *size > turn / 2.0);
    let mut short_ways: Vec<f64> = jumps
        .iter()
        .filter(|jump| **jump > AROUND * turn)
        .map(|jump| (turn - jump).abs())
        .collect();
    let around = short_ways.len();
    if around < JUMPS || 2 * around <= jumps.len() || steps.len() < jumps.len() {
        return false;
    }
    let usual = *short_ways.select_nth_unstable_by(around / 2, f64::total_cmp).1;
    let place = (LONG_STEPS * steps.len() as f64) as usize;
    let long = *steps.select_nth_unstable_by(place, f64::total_cmp).1;
    usual <= LONGER * long
}

/// Returns the turn that a range of values fills, in degrees or radians, from 0 on or around 0.
fn turn([low, high]: [f64; 2]) -> Option<f64> {
    [360.0, std::f64::consts::TAU].into_iter().find(|turn| {
        let slack = 0.01 * turn;
        let is_inside = [0.0, -*turn / 2.0]
            .into_iter()
            .any(|from| low >= from - slack && high <= from + turn + slack);
        high - low >= TURN * turn && is_inside
    })
}

fn autocorrelation(values: &[f64], stretches: &[Range<usize>], variance: f64) -> Vec<(usize, f64)> {
    variogram(variance, |lag, pairs| {
        for stretch in stretches.iter().filter(|stretch| stretch.len() > lag) {
            let first = &values[stretch.start..stretch.end - lag];
            let second = &values[stretch.start + lag..stretch.end];
            first.iter().zip(second).for_each(|(first, second)| pairs.add(*first, *second));
        }
    })
}

fn autocorrelation_of_samples(samples: &[Sample], variance: f64) -> Vec<(usize, f64)> {
    variogram(variance, |lag, pairs| {
        let mut later = samples.iter().peekable();
        for first in samples {
            let place = (first.stretch, first.row + lag);
            while later.next_if(|second| (second.stretch, second.row) < place).is_some() {}
            if let Some(second) = later.peek().filter(|other| (other.stretch, other.row) == place) {
                pairs.add(first.value, second.value);
            }
        }
    })
}

/// Squared differences of pairs of values.
#[derive(Default)]
struct Pairs {
    sum: f64,
    count: usize,
}

impl Pairs {
    fn add(&mut self, first: f64, second: f64) {
        let square = (second - first) * (second - first);
        if !square.is_nan() {
            self.sum += square;
            self.count += 1;
        }
    }
}

/// Returns `1 - mean((x[i + lag] - x[i])²) / (2 variance)` for each of [`LAGS`] with enough pairs, which `pairs_at`
/// adds.
fn variogram(variance: f64, pairs_at: impl Fn(usize, &mut Pairs)) -> Vec<(usize, f64)> {
    if variance <= 0.0 {
        return Vec::new();
    }
    let known = LAGS.iter().filter_map(|&lag| {
        let mut pairs = Pairs::default();
        pairs_at(lag, &mut pairs);
        let Pairs { sum, count } = pairs;
        (count >= 30).then(|| (lag, 1.0 - sum / count as f64 / (2.0 * variance)))
    });
    known.collect()
}

/// Returns the 95 % quantile of the lengths of runs of missing values between two present values in a stretch. `there`
/// has the stretch and the row of each value.
fn missing_run(there: impl Iterator<Item = (usize, usize)>) -> usize {
    let mut runs: Vec<usize> = Vec::new();
    let mut before = None;
    for (stretch, row) in there {
        if let Some((_, last)) = before.filter(|(known, last)| *known == stretch && row - last > 1)
        {
            runs.push(row - last - 1);
        }
        before = Some((stretch, row));
    }
    if runs.is_empty() {
        return 0;
    }
    let at = (runs.len() * 95 / 100).min(runs.len() - 1);
    *runs.select_nth_unstable(at).1
}

fn own_period(there: impl Iterator<Item = Timestamp>) -> Option<f64> {
    detect_period(&there.collect::<Vec<_>>()).map(Period::as_secs)
}

#[cfg(test)]
mod tests;
