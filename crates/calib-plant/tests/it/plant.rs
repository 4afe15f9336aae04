//! Tests of the plant as its users see it: a log, its ground truth, and its
//! repeatability.

use calib_core::{Period, Seed};
use calib_plant::{DayLog, Fate, Mode, Plant, PlantOptions};

const DAY_SECS: i64 = 86_400;

fn options(channels: usize, days: f64, period_secs: f64) -> PlantOptions {
    PlantOptions {
        channels,
        days,
        period: Period::from_secs(period_secs).expect("positive"),
        ..PlantOptions::default()
    }
}

fn log(options: &PlantOptions) -> Vec<DayLog> {
    Plant::new(options.clone()).expect("valid options").collect()
}

/// Returns one column over all days.
fn series(log: &[DayLog], channel: usize) -> Vec<f32> {
    log.iter().flat_map(|day| day.columns[channel].iter().copied()).collect()
}

fn times(log: &[DayLog]) -> Vec<i64> {
    log.iter().flat_map(|day| day.timestamps.iter().map(|time| time.as_micros())).collect()
}

fn position(plant: &Plant, name: &str) -> usize {
    plant.schema().iter().position(|channel| channel.name == name).expect("a known channel")
}

/// Returns the number of a mode in a log.
fn number(mode: Mode) -> f32 {
    f32::from(mode.number())
}

/// Returns the fate that preprocessing finds: the paper drops missing (above 0.1) and
/// constant sensors.
fn found(values: &[f32]) -> Fate {
    let missing = values.iter().filter(|value| value.is_nan()).count();
    let mut present = values.iter().filter(|value| !value.is_nan());
    if missing as f64 > 0.1 * values.len() as f64 {
        Fate::Missing
    } else if present.next().is_none_or(|first| present.all(|value| value == first)) {
        Fate::Constant
    } else {
        Fate::Alive
    }
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}

fn all_bits(day: &DayLog) -> Vec<Vec<u32>> {
    day.columns.iter().map(|column| bits(column)).collect()
}

/// Whether two days are equal to the bit, missing values included.
fn same(a: &DayLog, b: &DayLog) -> bool {
    (a.day, a.start, &a.timestamps) == (b.day, b.start, &b.timestamps) && all_bits(a) == all_bits(b)
}

#[test]
fn preprocessing_finds_the_truth() {
    for (channels, days, period_secs) in
        [(3, 1.0, 1.0), (24, 1.0, 1.0), (64, 2.0, 60.0), (480, 1.0, 10.0), (480, 1.0, 60.0)]
    {
        for seed in 0..3 {
            let options = PlantOptions {
                seed: Seed::new(seed),
                missing_fraction: 0.03,
                gaps_per_day: 4.0,
                stuck_per_day: 0.5,
                ..options(channels, days, period_secs)
            };
            let log = log(&options);
            let plant = Plant::new(options).unwrap();
            for (at, channel) in plant.schema().iter().enumerate() {
                let name = &channel.name;
                assert_eq!(
                    found(&series(&log, at)),
                    channel.fate,
                    "{name}, seed {seed}, period {period_secs}"
                );
            }
        }
    }
}

#[test]
fn a_day_is_the_same_whether_or_not_the_days_before_it_were_made() {
    let options =
        PlantOptions { gaps_per_day: 6.0, duplicates_per_day: 3.0, ..options(480, 3.5, 10.0) };
    let in_sequence = log(&options);
    assert_eq!(in_sequence.len(), 4);
    for skipped in 1..4 {
        let mut plant = Plant::new(options.clone()).unwrap();
        for day in 0..skipped {
            assert_eq!(plant.skip_day(), Some(day));
        }
        let after: Vec<DayLog> = plant.collect();
        assert_eq!(after.len(), 4 - skipped as usize);
        for (a, b) in in_sequence[skipped as usize..].iter().zip(&after) {
            assert!(same(a, b), "day {} after skipping {skipped}", a.day);
        }
    }
}

#[test]
fn bytes_do_not_depend_on_threads_and_do_on_the_seed() {
    let options = options(64, 1.0, 10.0);
    let [one, four] = [1, 4].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| log(&options))
    });
    assert!(same(&one[0], &four[0]));
    let other = log(&PlantOptions { seed: Seed::new(1), ..options.clone() });
    assert!(!same(&one[0], &other[0]));
}

#[test]
fn a_channel_does_not_depend_on_its_neighbours() {
    let small = options(24, 1.0, 10.0);
    let large = options(480, 1.0, 10.0);
    let small_log = log(&small);
    let large_log = log(&large);
    let small = Plant::new(small).unwrap();
    let large = Plant::new(large).unwrap();
    for (at, channel) in small.schema().iter().enumerate() {
        let there = position(&large, &channel.name);
        assert_eq!(
            bits(&small_log[0].columns[at]),
            bits(&large_log[0].columns[there]),
            "{}",
            channel.name
        );
    }
}

#[test]
fn time_advances_by_the_period_but_for_gaps() {
    let options = PlantOptions { gaps_per_day: 0.0, ..options(3, 2.5, 7.0) };
    let log = log(&options);
    let times = times(&log);
    assert_eq!(times.len(), Plant::new(options.clone()).unwrap().instants() as usize);
    assert_eq!(times[0], options.start.as_micros());
    assert!(times.windows(2).all(|pair| pair[1] - pair[0] == 7_000_000));
    for day in &log {
        let start = day.start.as_micros();
        assert!(day.timestamps[0].as_micros() - start < 7_000_000);
        let last = day.timestamps.last().unwrap().as_micros();
        assert!(last - start < DAY_SECS * 1_000_000);
        assert!(day.columns.iter().all(|column| column.len() == day.timestamps.len()));
    }
}

/// Counts gaps and repeated times in sixty days.
fn count_gaps_and_repeats(gaps_per_day: f64, duplicates_per_day: f64) -> (usize, usize) {
    let options = PlantOptions { gaps_per_day, duplicates_per_day, ..options(3, 60.0, 60.0) };
    let times = times(&log(&options));
    let steps = times.windows(2).map(|pair| pair[1] - pair[0]);
    assert!(steps.clone().all(|step| step >= 0));
    let repeated = steps.clone().filter(|&step| step == 0).count();
    (steps.filter(|&step| step > 60_000_000).count(), repeated)
}

#[test]
fn gaps_and_duplicates_come_when_asked_for() {
    assert_eq!(count_gaps_and_repeats(0.0, 0.0), (0, 0));
    let (gaps, repeated) = count_gaps_and_repeats(3.0, 5.0);
    assert!((130..=230).contains(&gaps), "{gaps} gaps in 60 days");
    assert!((240..=360).contains(&repeated), "{repeated} repeats in 60 days");
}

#[test]
fn missing_values_have_the_wanted_share() {
    for period_secs in [10.0, 60.0] {
        let options = PlantOptions { missing_fraction: 0.01, ..options(4, 60.0, period_secs) };
        let log = log(&options);
        for channel in 0..4 {
            let values = series(&log, channel);
            let share =
                values.iter().filter(|value| value.is_nan()).count() as f64 / values.len() as f64;
            assert!((0.0075..0.0125).contains(&share), "channel {channel}: {share}");
        }
    }
    let none = log(&PlantOptions { missing_fraction: 0.0, ..options(4, 2.0, 10.0) });
    assert!(none.iter().all(|day| day.columns.iter().flatten().all(|value| !value.is_nan())));
}

#[test]
fn the_log_shows_the_schedule_of_the_pilot() {
    for period_secs in [5.0, 20.0] {
        let log = log(&options(4, 120.0, period_secs));
        let modes: Vec<f32> = series(&log, 3).into_iter().filter(|mode| !mode.is_nan()).collect();
        let share = |mode: Mode| {
            modes.iter().filter(|&&at| at == number(mode)).count() as f64 / modes.len() as f64
        };
        // Shares of the published November, which had no chemical clean.
        for (mode, expected) in [
            (Mode::Production, 0.7416),
            (Mode::Standby, 0.1055),
            (Mode::BackPulse, 0.0355),
            (Mode::DrainAndRefill, 0.0966),
        ] {
            let got = share(mode);
            assert!((got / expected - 1.0).abs() < 0.15, "{mode:?}: {got}, expected {expected}");
        }
        let clean = share(Mode::ChemicalClean);
        assert!((0.003..0.02).contains(&clean), "{clean}");
    }
}

fn mean_pressure(rows: &[f32]) -> f64 {
    f64::from(rows.iter().sum::<f32>()) / rows.len() as f64
}

#[test]
fn pressure_builds_up_and_drops_after_a_back_pulse() {
    let log =
        log(&PlantOptions { gaps_per_day: 0.0, missing_fraction: 0.0, ..options(4, 10.0, 5.0) });
    let pressure = series(&log, 0);
    let modes = series(&log, 3);
    let mut before = Vec::new();
    let mut after = Vec::new();
    let mut pulse = Vec::new();
    for start in 240..modes.len() - 240 {
        let begins = modes[start] == number(Mode::BackPulse) && modes[start - 1] != modes[start];
        let produced =
            modes[start - 240..start].iter().all(|&mode| mode == number(Mode::Production));
        if !begins || !produced {
            continue;
        }
        // Twenty minutes of production, a back-pulse, a drain, and production again.
        let next = (start..start + 100).find(|&row| modes[row] == number(Mode::Production));
        let Some(next) =
            next.filter(|next| modes[*next..next + 36].iter().all(|&mode| mode == modes[*next]))
        else {
            continue;
        };
        before.push(mean_pressure(&pressure[start - 12..start]));
        pulse.push(mean_pressure(&pressure[start + 6..start + 18]));
        after.push(mean_pressure(&pressure[next + 12..next + 36]));
    }
    assert!(before.len() > 30, "{} cycles in 10 days", before.len());
    let drops =
        before.iter().zip(&after).filter(|(before, after)| **after < **before - 1.0).count();
    assert!(drops as f64 > 0.95 * before.len() as f64, "{drops} of {}", before.len());
    assert!(pulse.iter().all(|&pressure| pressure < -10.0));
}

#[test]
fn pressure_creeps_up_until_the_clean() {
    let log = log(&options(4, 60.0, 60.0));
    let pressure = series(&log, 0);
    let modes = series(&log, 3);
    let clean = modes.iter().position(|&mode| mode == number(Mode::ChemicalClean));
    let clean = clean.expect("a clean within 60 days");
    let stretches = [0..1440, clean - 1440..clean, clean + 360..clean + 1800];
    let [first, last, cleaned] = stretches.map(|rows| {
        let values: Vec<f32> = rows
            .filter(|&row| modes[row] == number(Mode::Production) && !pressure[row].is_nan())
            .map(|row| pressure[row])
            .collect();
        values.iter().sum::<f32>() / values.len() as f32
    });
    assert!(last > first + 3.0 && cleaned < last - 3.0, "{first} {last} {cleaned}");
}

#[test]
fn temperature_has_a_daily_cycle() {
    let log = log(&PlantOptions { gaps_per_day: 0.0, ..options(3, 40.0, 60.0) });
    let temperature = series(&log, 1);
    let [afternoon, night] = [16, 4].map(|hour: usize| {
        let hours = temperature.chunks(1440).flat_map(|day| &day[hour * 60..(hour + 1) * 60]);
        let present: Vec<f32> = hours.copied().filter(|value| !value.is_nan()).collect();
        present.iter().sum::<f32>() / present.len() as f32
    });
    let swing = afternoon - night;
    assert!((0.9..2.5).contains(&swing), "{swing} °C from 4 to 16 o'clock");
}

#[test]
fn two_days_of_the_default_plant_have_something_to_predict() {
    for seed in 0..6 {
        let log = log(&PlantOptions { seed: Seed::new(seed), ..options(3, 2.0, 5.0) });
        let [pressure, temperature, turbidity] = [0, 1, 2].map(|channel: usize| {
            let mut values = series(&log, channel);
            values.retain(|value| !value.is_nan());
            values.sort_unstable_by(f32::total_cmp);
            [0.05, 0.5, 0.95, 1.0].map(|q: f64| values[(q * (values.len() - 1) as f64) as usize])
        });
        let [low, middle, high, _] = pressure;
        assert!(low < 1.0 && middle > 10.0 && high > middle + 4.0, "PIT300 {low} {middle} {high}");
        let [low, _, high, _] = temperature;
        assert!(high > low + 0.8, "TIT101 {low} {high}");
        let [low, middle, high, top] = turbidity;
        assert!(
            low < 0.12 && high > middle + 0.05 && top > 0.3 && top <= 5.0,
            "TUIT101 {low} {middle} {high} {top}"
        );
    }
}

fn temperature(options: &PlantOptions) -> Vec<f32> {
    series(&log(options), 1)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[test]
fn noise_and_drift_can_be_switched_off() {
    let plain = PlantOptions { noise: 0.0, drift: 0.0, stuck_per_day: 0.0, ..options(3, 2.0, 1.0) };
    let noisy = PlantOptions { noise: 2.0, ..plain.clone() };
    let drifting = PlantOptions { drift: 10.0, ..plain.clone() };
    let plain = temperature(&plain);
    let noisy = temperature(&noisy);
    let drifting = temperature(&drifting);
    let [noise, drift] = [&noisy, &drifting].map(|other| -> Vec<f64> {
        let pairs = plain.iter().zip(other).filter(|(a, b)| !a.is_nan() && !b.is_nan());
        pairs.map(|(a, b)| f64::from(b - a)).collect()
    });
    let deviation = mean(&noise.iter().map(|x| x * x).collect::<Vec<_>>()).sqrt();
    // Twice 0.0004 of the range of 30 °C.
    assert!((deviation / 0.024 - 1.0).abs() < 0.05, "{deviation}");
    assert!(mean(&drift).abs() > 0.05 && drift.iter().all(|x| x.abs() < 1.3), "{}", mean(&drift));
}

/// Returns the largest number of successive rows with the same pressure.
fn longest_run(stuck_per_day: f64) -> usize {
    let options = PlantOptions {
        stuck_per_day,
        missing_fraction: 0.0,
        gaps_per_day: 0.0,
        ..options(3, 1.0, 1.0)
    };
    let pressure = series(&log(&options), 0);
    let runs = pressure.chunk_by(|a, b| a == b).map(<[f32]>::len);
    runs.max().unwrap_or(0)
}

#[test]
fn stuck_periods_freeze_a_value() {
    assert!(longest_run(0.0) < 30);
    assert!(longest_run(8.0) > 300);
}
