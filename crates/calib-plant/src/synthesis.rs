use std::{f64::consts::TAU, ops::Range};

use calib_core::Seed;

use crate::{
    Sensor,
    change::Timeline,
    channel::{Availability, Channel, Instrument, Recipe, name_number},
    faults::{DayGrid, Faults},
    options::{PlantOptions, SECONDS_PER_DAY},
    signal::Signals,
};

/// Number of input cards that channels are wired to. An outage affects all channels of a card at once.
const CARDS: u64 = 6;
/// Maximum share of a day's rows that a card can miss. Preprocessing drops a channel above 0.1.
const MOST_MISSING: f64 = 0.08;

/// Returns one column of the day: a value per instant, NaN where it is missing.
///
/// The result does not depend on the other channels or the number of threads. It follows from the signals,
/// the options, the channel's name, the number of the day, and the changes of its `sensor`, if there are any.
pub(crate) fn column(
    channel: &Channel,
    sensor: Option<&Timeline<Sensor>>,
    options: &PlantOptions,
    signals: &Signals,
    grid: &DayGrid,
) -> Vec<f32> {
    if channel.availability == Availability::Never {
        return vec![f32::NAN; grid.rows];
    }
    let seed = options.seed.child("channel").child(&channel.info.name);
    let mut values = ideal(channel.recipe, signals, grid);
    measure(channel.instrument, sensor, &mut values, options, seed, grid);
    if let Availability::Scheduled { cycle_secs, phase_secs, share } = channel.availability {
        for (row, value) in values.iter_mut().enumerate() {
            let into_cycle = (grid.secs(row) + phase_secs) % cycle_secs;
            if into_cycle >= share * cycle_secs {
                *value = f32::NAN;
            }
        }
    }
    let card = name_number(&channel.info.name) % CARDS;
    for span in card_outages(options, card).touching(grid, MOST_MISSING) {
        values[span].fill(f32::NAN);
    }
    values
}

/// Returns the values before any instrument error.
fn ideal(recipe: Recipe, signals: &Signals, grid: &DayGrid) -> Vec<f32> {
    match recipe {
        Recipe::Lagged { signal, lag_secs } => {
            let lag = (lag_secs / grid.period_secs).round() as usize;
            signals.lagged(signal, lag.min(signals.history())).to_vec()
        }
        Recipe::Filtered { signal, tau_secs } => {
            let values = signals.with_history(signal);
            let gain = 1.0 - (-grid.period_secs / tau_secs).exp();
            let mut level = f64::from(values[0]);
            let filtered = values.iter().map(|&value| {
                level += gain * (f64::from(value) - level);
                level as f32
            });
            filtered.skip(signals.history()).collect()
        }
        Recipe::Sum(a, b) => combined(signals.day(a), signals.day(b), |a, b| a + b),
        Recipe::Difference(a, b) => combined(signals.day(a), signals.day(b), |a, b| a - b),
        Recipe::Ratio(a, b, least) => {
            combined(signals.day(a), signals.day(b), |a, b| if b >= least { a / b } else { 0.0 })
        }
        Recipe::Constant(value) => vec![value; grid.rows],
    }
}

fn combined(a: &[f32], b: &[f32], combine: impl Fn(f32, f32) -> f32) -> Vec<f32> {
    a.iter().zip(b).map(|(&a, &b)| combine(a, b)).collect()
}

/// Applies the errors of instrument and historian to the values: noise and drift, the range, the steps of the
/// converter, frozen periods, then the dead-band (a value is kept until it has changed by more). The
/// historian begins every day with a fresh value.
fn measure(
    instrument: Instrument,
    sensor: Option<&Timeline<Sensor>>,
    values: &mut [f32],
    options: &PlantOptions,
    seed: Seed,
    grid: &DayGrid,
) {
    let Instrument::Analog { range: (low, high), noise, drift, resolution, dead_band } = instrument
    else {
        return;
    };
    let mut rng = seed.child("noise").number(u64::from(grid.day)).rng();
    let noise = noise * options.noise;
    let drift = drift * options.drift;
    let from = drift * wander(seed, grid.day);
    let to = drift * wander(seed, grid.day + 1);
    let per_step = 1.0 / resolution;
    for (row, value) in values.iter_mut().enumerate() {
        let mut exact = f64::from(*value) + from + (to - from) * grid.share(row);
        if noise > 0.0 {
            exact += noise * noise_factor(sensor, grid.secs(row)) * rng.normal();
        }
        *value = ((exact.clamp(low, high) * per_step).round() * resolution) as f32;
    }
    for span in stuck_periods(options, seed).within(grid) {
        let Range { start, end } = span;
        let frozen = values[start];
        values[start..end].fill(frozen);
    }
    if dead_band > 0.0 {
        let mut shown = values[0];
        for value in values.iter_mut() {
            if f64::from((*value - shown).abs()) > dead_band {
                shown = *value;
            }
            *value = shown;
        }
    }
}

/// Returns the factor on the noise of a sensor at `t`.
fn noise_factor(sensor: Option<&Timeline<Sensor>>, t: f64) -> f64 {
    sensor.and_then(|timeline| timeline.at(t)).map_or(1.0, |sensor| sensor.value.noise)
}

/// Returns the slow drift at the beginning of a day, about −1 to 1: a slow and a faster sine whose periods
/// and phases belong to the channel. Between days it is linear.
fn wander(seed: Seed, day: u32) -> f64 {
    let mut rng = seed.child("drift").rng();
    let slow = rng.uniform(20.0, 60.0);
    let fast = rng.uniform(3.0, 10.0);
    let slow_phase = rng.unit();
    let fast_phase = rng.unit();
    let day = f64::from(day);
    0.7 * (TAU * (day / slow + slow_phase)).sin() + 0.3 * (TAU * (day / fast + fast_phase)).sin()
}

fn stuck_periods(options: &PlantOptions, seed: Seed) -> Faults {
    Faults {
        seed: seed.child("stuck"),
        per_day: options.stuck_per_day,
        median_secs: 1200.0,
        spread: 0.7,
        longest_secs: 6.0 * 3600.0,
    }
}

/// Returns the outages of an input card: many short ones, which add up to the expected missing share of a
/// channel.
fn card_outages(options: &PlantOptions, card: u64) -> Faults {
    let median_secs = 8.0;
    let spread = 1.0;
    let mean_secs = median_secs * f64::exp(spread * spread / 2.0);
    Faults {
        seed: options.seed.child("card").number(card),
        per_day: options.missing_fraction * SECONDS_PER_DAY / mean_secs,
        median_secs,
        spread,
        longest_secs: 600.0,
    }
}

/// Returns the outages of the historian: rows that are absent.
pub(crate) fn gaps(options: &PlantOptions, grid: &DayGrid) -> Vec<Range<usize>> {
    let faults = Faults {
        seed: options.seed.child("gaps"),
        per_day: options.gaps_per_day,
        median_secs: 300.0,
        spread: 0.8,
        longest_secs: 3600.0,
    };
    // At most a tenth of a day, so that missing values stay below 0.1 of the rows that remain.
    faults.touching(grid, 0.1)
}
