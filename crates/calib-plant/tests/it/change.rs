//! Tests of the changes of a plant, as its log shows them.

use calib_core::{Period, Seed};
use calib_plant::{
    Change, ChangeKind, ChangeOptions, DayLog, Fate, MODE_CHANNEL, Mode, Plant, PlantOptions,
};
use proptest::prelude::*;

/// Returns options with the same rate for every kind of change.
const fn all(per_year: f64) -> ChangeOptions {
    ChangeOptions {
        strength: 1.0,
        membranes_per_year: per_year,
        feeds_per_year: per_year,
        sensors_per_year: per_year,
        settings_per_year: per_year,
        pumps_per_year: per_year,
    }
}

const STILL: ChangeOptions = all(0.0);

/// Returns the number of a mode in a log.
fn number(mode: Mode) -> f32 {
    f32::from(mode.number())
}

fn options(days: f64, period_secs: f64, change: ChangeOptions) -> PlantOptions {
    PlantOptions {
        days,
        period: Period::from_secs(period_secs).expect("positive"),
        gaps_per_day: 0.0,
        change,
        ..PlantOptions::default()
    }
}

fn plant(options: &PlantOptions) -> Plant {
    Plant::new(options.clone()).expect("valid options")
}

fn log(options: &PlantOptions) -> Vec<DayLog> {
    plant(options).collect()
}

fn position(options: &PlantOptions, name: &str) -> usize {
    plant(options).schema().iter().position(|channel| channel.name == name).expect("a channel")
}

/// Returns one column over all days.
fn column(log: &[DayLog], channel: usize) -> Vec<f32> {
    log.iter().flat_map(|day| day.columns[channel].iter().copied()).collect()
}

/// Returns the rows in which two logs differ in a channel.
fn differing(a: &[DayLog], b: &[DayLog], channel: usize) -> Vec<usize> {
    let a = column(a, channel);
    let b = column(b, channel);
    assert_eq!(a.len(), b.len());
    (0..a.len()).filter(|&row| a[row].to_bits() != b[row].to_bits()).collect()
}

/// Returns the first row at or after a change.
fn row_of(change: &Change, options: &PlantOptions) -> usize {
    let micros = change.at.as_micros() - options.start.as_micros();
    micros.div_euclid(options.period.as_micros()) as usize
        + usize::from(micros % options.period.as_micros() != 0)
}

/// The means of the three roles over two days are those from before changes were introduced.
#[test]
fn the_plant_without_change_is_what_it_always_was() {
    let log = log(&options(2.0, 60.0, ChangeOptions::default()));
    for (channel, expected) in [(0, 18.628_682_978), (1, 5.912_447_592), (2, 0.094_951_750)] {
        let mut values = column(&log, channel);
        values.retain(|value| !value.is_nan());
        let mean = values.iter().copied().map(f64::from).sum::<f64>() / values.len() as f64;
        assert!((mean / expected - 1.0).abs() < 1e-6, "channel {channel}: {mean}");
    }
}

#[test]
fn a_plant_whose_rates_are_zero_is_the_plant_without_change() {
    let still = options(2.0, 10.0, STILL);
    let none = options(2.0, 10.0, ChangeOptions::default());
    assert!(plant(&still).changes().is_empty());
    let still = log(&still);
    let none = log(&none);
    for channel in 0..still[0].columns.len() {
        assert_eq!(differing(&still, &none, channel), [] as [usize; 0]);
    }
}

#[test]
fn the_log_before_the_first_change_is_that_of_the_plant_without() {
    let often = ChangeOptions { sensors_per_year: 2.0, ..all(10.0) };
    for seed in 0..4 {
        let changing = PlantOptions { seed: Seed::new(seed), ..options(40.0, 60.0, often) };
        let same = PlantOptions { change: ChangeOptions::default(), ..changing.clone() };
        let first = plant(&changing).changes().first().map(|first| row_of(first, &changing));
        let first = first.expect("something changes in 40 days");
        let changing = log(&changing);
        let same = log(&same);
        let rows: Vec<Vec<usize>> = (0..changing[0].columns.len())
            .map(|channel| differing(&changing, &same, channel))
            .collect();
        assert!(rows.iter().flatten().all(|&row| row >= first), "seed {seed}, from row {first}");
        assert!(rows.iter().any(|rows| !rows.is_empty()), "seed {seed}");
    }
}

#[test]
fn a_sensor_changes_its_channels_and_no_others() {
    let often = ChangeOptions { sensors_per_year: 3.0, ..STILL };
    let changing = PlantOptions { channels: 142, ..options(30.0, 60.0, often) };
    let same = PlantOptions { change: ChangeOptions::default(), ..changing.clone() };
    let changes = plant(&changing).changes();
    let tags: Vec<&str> = changes
        .iter()
        .map(|change| match &change.kind {
            ChangeKind::Sensor { tag, .. } => tag.as_str(),
            other => panic!("{other:?}"),
        })
        .collect();
    let names: Vec<String> =
        plant(&changing).schema().iter().map(|channel| channel.name.clone()).collect();
    let changing = log(&changing);
    let same = log(&same);
    assert!(tags.len() > 3 && tags.len() < names.len());
    for (at, name) in names.iter().enumerate() {
        let own = name.split('.').next().expect("a part");
        let rows = differing(&changing, &same, at);
        if tags.contains(&name.as_str()) {
            assert!(!rows.is_empty(), "{name} was changed");
        }
        // Copies are named after their sensor; sums, differences, ratios and analysers may show any sensor.
        let computed =
            ["DI", "SI", "CALC", "ERR", "CPI", "LAB"].iter().any(|part| name.contains(part));
        if !computed && !tags.contains(&own) {
            assert!(rows.is_empty(), "{name} was not changed");
        }
    }
}

/// Returns options for two months of sensors without faults or errors.
fn quiet(period_secs: f64, change: ChangeOptions) -> PlantOptions {
    PlantOptions {
        noise: 0.0,
        drift: 0.0,
        stuck_per_day: 0.0,
        missing_fraction: 0.0,
        ..options(60.0, period_secs, change)
    }
}

#[test]
fn a_moved_sensor_shows_gain_and_offset() {
    let often = ChangeOptions { sensors_per_year: 12.0, ..STILL };
    let changing = quiet(60.0, often);
    let of_temperature: Vec<Change> = plant(&changing)
        .changes()
        .into_iter()
        .filter(|change| matches!(&change.kind, ChangeKind::Sensor { tag, .. } if tag == "TIT101"))
        .collect();
    let last = of_temperature.last().expect("TIT101 is changed in two months");
    let ChangeKind::Sensor { sensor, .. } = &last.kind else { panic!("a sensor") };
    let from = row_of(last, &changing) + 60;
    let truth = column(&log(&quiet(60.0, ChangeOptions::default())), 1);
    let shown = column(&log(&changing), 1);
    let errors: Vec<f64> = (from..truth.len())
        .map(|row| sensor.gain * f64::from(truth[row]) + sensor.offset - f64::from(shown[row]))
        .collect();
    assert!(errors.len() > 1000, "{} rows", errors.len());
    // The tolerance covers steps of the converter, and the lag of the time constant while the water is exchanged.
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    assert!(mean.abs() < 0.02, "{mean} °C");
}

#[test]
fn a_feed_comes_without_a_jump() {
    let often = ChangeOptions { strength: 2.0, feeds_per_year: 30.0, ..STILL };
    let changing = PlantOptions { storms_per_day: 0.0, channels: 24, ..quiet(300.0, often) };
    let same = PlantOptions { change: ChangeOptions::default(), ..changing.clone() };
    assert!(plant(&changing).changes().len() > 2);
    let with = log(&changing);
    let without = log(&same);
    // Of the quantities in the pipe, only salt keeps its value while the feed is off, for hours at most.
    let at = position(&changing, "CIT101");
    let shift: Vec<f64> = column(&with, at)
        .iter()
        .zip(&column(&without, at))
        .map(|(with, without)| f64::from(with - without))
        .collect();
    let steps = shift.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    let step = steps.fold(0.0, f64::max);
    assert!(step < 10.0, "it jumps by {step} µS/cm in five minutes");
    let change = shift.iter().copied().map(f64::abs).fold(0.0, f64::max);
    assert!(change > 40.0, "it changes by {change} µS/cm");
}

#[test]
fn membranes_and_pumps_are_exchanged_while_the_plant_stands_still() {
    for (change, name) in [
        (ChangeOptions { membranes_per_year: 12.0, ..STILL }, "PIT300"),
        (ChangeOptions { pumps_per_year: 24.0, ..STILL }, "P301.SCOUTPUT"),
    ] {
        let changing = options(60.0, 60.0, change);
        let same = PlantOptions { change: ChangeOptions::default(), ..changing.clone() };
        let first = row_of(&plant(&changing).changes()[0], &changing);
        let mode = position(&changing, MODE_CHANNEL);
        let channel = position(&changing, name);
        let with = log(&changing);
        let without = log(&same);
        let modes = column(&with, mode);
        let rows = differing(&with, &without, channel);
        let seen = *rows.first().expect("it is seen");
        let stands = [Mode::Stopped, Mode::Standby, Mode::ChemicalClean].map(number);
        assert!(
            (first..=seen).any(|row| stands.contains(&modes[row])),
            "{name}, {first} to {seen}"
        );
        assert!(differing(&with, &without, mode).is_empty(), "the schedule stays");
    }
}

#[test]
fn settings_change_the_schedule_and_the_flow() {
    let often = ChangeOptions { settings_per_year: 6.0, ..STILL };
    let changing = PlantOptions { channels: 142, ..options(200.0, 60.0, often) };
    let changes = plant(&changing).changes();
    let longest = changes.windows(2).max_by_key(|pair| pair[1].at.micros_since(pair[0].at));
    let [from, to] = longest.expect("several") else { panic!("a pair") };
    let ChangeKind::Settings(settings) = &from.kind else { panic!("{from:?}") };
    let rows = row_of(from, &changing)..row_of(to, &changing);
    let log = log(&changing);
    let target = column(&log, position(&changing, "FIC301_P.SPProg"));
    let highest =
        target[rows.clone()].iter().copied().filter(|value| !value.is_nan()).fold(0.0, f32::max);
    assert!((f64::from(highest) / (0.3 * settings.production) - 1.0).abs() < 1e-3, "{highest}");
    let modes = column(&log, position(&changing, MODE_CHANNEL));
    // Most times of production up to a back-pulse are 1,200 s.
    let mut lengths: Vec<usize> = Vec::new();
    let mut began = rows.start;
    for row in rows.start + 1..rows.end {
        if modes[row] != modes[row - 1] {
            if modes[row] == number(Mode::BackPulse) && began > rows.start {
                lengths.push(row - began);
            }
            began = row;
        }
    }
    lengths.sort_unstable();
    let median = lengths[lengths.len() / 2] as f64 * 60.0;
    let expected = 1200.0 * settings.back_pulse_interval;
    assert!((median / expected - 1.0).abs() < 0.06, "{median} s, expected {expected} s");
}

#[test]
fn a_changing_day_is_the_same_whether_or_not_the_days_before_it_were_made() {
    let often = ChangeOptions { sensors_per_year: 20.0, ..all(50.0) };
    let changing = options(12.5, 60.0, often);
    let whole = log(&changing);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().expect("threads");
    for skipped in [1, 5, 12] {
        let mut plant = plant(&changing);
        (0..skipped).for_each(|_| {
            plant.skip_day();
        });
        let rest: Vec<DayLog> = pool.install(|| plant.collect());
        for channel in 0..rest[0].columns.len() {
            assert_eq!(differing(&whole[skipped..], &rest, channel), [] as [usize; 0]);
        }
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Returns the mean squared error of a model of the first `known` rows in the rows after them. The model is a
/// channel's mean in each mode. The unit is the variance of the first rows.
fn error_after(log: &[DayLog], known: usize, channel: usize, mode: usize) -> f64 {
    let values = column(log, channel);
    let modes = column(log, mode);
    let [learnt, after] = [0..known, known..values.len()].map(|range| {
        range
            .map(|row: usize| (modes[row].to_bits(), f64::from(values[row])))
            .filter(|(_, value)| !value.is_nan())
            .collect::<Vec<_>>()
    });
    let all: Vec<f64> = learnt.iter().map(|(_, value)| *value).collect();
    let whole = mean(&all);
    let variance = mean(&all.iter().map(|value| (value - whole).powi(2)).collect::<Vec<_>>());
    let means: std::collections::BTreeMap<u32, f64> = Mode::ALL
        .iter()
        .map(|mode| {
            let mode = number(*mode).to_bits();
            let own: Vec<f64> =
                learnt.iter().filter(|row| row.0 == mode).map(|row| row.1).collect();
            (mode, if own.is_empty() { whole } else { mean(&own) })
        })
        .collect();
    mean(
        &after
            .iter()
            .map(|(mode, value): &(u32, f64)| (value - means.get(mode).unwrap_or(&whole)).powi(2))
            .collect::<Vec<_>>(),
    ) / variance
}

#[test]
fn what_was_learnt_before_is_wrong_after() {
    let often = ChangeOptions { sensors_per_year: 6.0, ..all(12.0) };
    // The weather is the same with and without change, so all differences are due to change.
    let half = 45;
    let mut errors = [0.0; 2];
    for seed in 0..3 {
        for (total, change) in errors.iter_mut().zip([ChangeOptions::default(), often]) {
            let options = PlantOptions { seed: Seed::new(seed), ..options(90.0, 900.0, change) };
            let mode = position(&options, MODE_CHANNEL);
            let log = log(&options);
            for channel in
                (0..3).chain([position(&options, "CIT101"), position(&options, "LIT602")])
            {
                *total += error_after(&log, half * 96, channel, mode);
            }
        }
    }
    assert!(errors[1] > 1.25 * errors[0], "without change {}, with it {}", errors[0], errors[1]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6))]

    /// However much and however often a plant changes, preprocessing finds in each channel the fate of the schema. No
    /// value is infinite, and NaN occurs only in outages.
    #[test]
    fn a_plant_that_changes_stays_a_plant(
        seed: u64, strength in 0.0_f64..2.0, per_year in 0.0_f64..50.0, channels in 3_usize..480
    ) {
        let change = ChangeOptions { strength, ..all(per_year) };
        let options =
            PlantOptions { channels, seed: Seed::new(seed), ..options(40.0, 600.0, change) };
        let plant = plant(&options);
        let (schema, changes) = (plant.schema().to_vec(), plant.changes());
        prop_assert!(changes.is_sorted_by(|a, b| a.at <= b.at));
        let log: Vec<DayLog> = plant.collect();
        for (at, channel) in schema.iter().enumerate() {
            let values = column(&log, at);
            prop_assert!(values.iter().all(|value| !value.is_infinite()));
            let present: Vec<f32> = values.iter().copied().filter(|value| !value.is_nan()).collect();
            if channel.fate == Fate::Alive {
                prop_assert!(present.len() as f64 > 0.9 * values.len() as f64, "{}", channel.name);
                prop_assert!(present.iter().any(|value| *value != present[0]), "{}", channel.name);
            }
        }
    }
}
