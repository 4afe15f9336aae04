//! Sketches of invented logs for tests.

use std::ops::Range;

use calib_core::Timestamp;
use calib_data::{BackwardSteps, ChannelSketch, Shape, ShownClock, Sketch};

/// Function from the row to the value of a channel.
pub(crate) type Channel = Box<dyn Fn(usize) -> f64>;

/// Returns a wave with a period of `length` rows.
pub(crate) fn wave(length: f64) -> Channel {
    Box::new(move |row| (std::f64::consts::TAU * row as f64 / length).sin())
}

/// Returns a log with one row per minute and no gaps.
pub(crate) fn sketch(rows: usize, channels: &[(&str, Channel)]) -> Sketch {
    let bins: Vec<Range<usize>> =
        (0..64).map(|bin| bin * rows / 64..(bin + 1) * rows / 64).collect();
    Sketch {
        shape: Shape::Wide,
        utc: false,
        clock: ShownClock::default(),
        without_times: false,
        read_as: Vec::new(),
        files: 1,
        bad_rows: calib_data::BadRowsFound::default(),
        unused_excludes: Vec::new(),
        sentinels: Vec::new(),
        period_secs: 60.0,
        recorded_period_secs: None,
        resampled: false,
        backward_steps: BackwardSteps::default(),
        timestamps: (0..rows as i64).map(|row| Timestamp::from_micros(row * 60_000_000)).collect(),
        channels: channels
            .iter()
            .map(|(name, values)| channel(name, values, rows, &bins))
            .collect(),
        bins,
    }
}

fn channel(name: &str, value_at: &Channel, rows: usize, bins: &[Range<usize>]) -> ChannelSketch {
    let values: Vec<f64> = (0..rows).map(value_at).collect();
    let there: Vec<f64> = values.iter().copied().filter(|value| !value.is_nan()).collect();
    let changes: Vec<f64> = there.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let changed: Vec<f64> = changes.iter().copied().filter(|change| *change != 0.0).collect();
    let mean = there.iter().sum::<f64>() / there.len().max(1) as f64;
    let variance =
        there.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / there.len().max(1) as f64;
    let mut distinct: Vec<u64> = there.iter().map(|value| value.to_bits()).collect();
    distinct.sort_unstable();
    distinct.dedup();
    let first = changed.first().copied().unwrap_or_default();
    let lags = [1, 2, 3, 5, 10, 15, 20, 30, 60, 100, 200, 500, 1_000];
    ChannelSketch {
        name: name.to_owned(),
        angle: None,
        text: None,
        present: bins
            .iter()
            .map(|bin| {
                let values = &values[bin.clone()];
                share(values.iter().filter(|value| !value.is_nan()).count(), values.len())
            })
            .collect(),
        moves: bins
            .iter()
            .map(|bin| {
                values[bin.clone()].windows(2).any(|pair| pair[1] != pair[0] && !pair[1].is_nan())
            })
            .collect(),
        distinct: (distinct.len() <= 256).then_some(distinct.len() as u32),
        range: (!there.is_empty()).then(|| {
            [
                there.iter().copied().fold(f64::MAX, f64::min),
                there.iter().copied().fold(f64::MIN, f64::max),
            ]
        }),
        rises: share(changed.iter().filter(|change| **change > 0.0).count(), changed.len()),
        even: share(
            changed.iter().filter(|change| (**change - first).abs() < 1e-9).count(),
            changed.len(),
        ),
        restarts: false,
        wraps: None,
        longest_stuck_secs: 0.0,
        stuck_at: None,
        unchanged: share(changes.len() - changed.len(), changes.len()),
        autocorrelation: lags
            .into_iter()
            .filter(|lag| lag + 30 < there.len() && variance > 0.0)
            .map(|lag| {
                let pairs = there.len() - lag;
                let squares: f64 =
                    (0..pairs).map(|row| (there[row + lag] - there[row]).powi(2)).sum();
                (lag, 1.0 - squares / pairs as f64 / (2.0 * variance))
            })
            .collect(),
        spikes: 0,
        unit_change: None,
        contradicting: 0,
        bridged: calib_data::BridgedStops::default(),
        thinned: values.iter().step_by(rows.div_ceil(4_000)).copied().collect(),
        missing_run: 0,
        own_period_secs: Some(60.0),
    }
}

fn share(count: usize, all: usize) -> f64 {
    count as f64 / all.max(1) as f64
}
