//! Measures how much the second year of a plant differs from the first, with and without change.
//!
//! ```text
//! years [SEEDS]
//! ```
//!
//! The measure is the 1-Wasserstein distance between the values of two successive years (hourly rows, 24 channels), in
//! standard deviations of the first year. It is given for each kind and strength of change as the mean over SEEDS
//! plants (6): for the three sensors that the paper predicts, and for all sensors. A normaliser and a model of the
//! first year are off by as much in the second.

#![expect(clippy::print_stdout, reason = "a program prints")]

use calib_core::{Period, Seed};
use calib_plant::{ChangeOptions, Plant, PlantOptions, ROLES};

const YEAR_DAYS: f64 = 365.0;

/// Number of quantiles by which samples are compared.
const QUANTILES: usize = 1000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let seeds: u64 = std::env::args().nth(1).map_or(Ok(6), |text| text.parse())?;
    let none = ChangeOptions {
        strength: 1.0,
        membranes_per_year: 0.0,
        feeds_per_year: 0.0,
        sensors_per_year: 0.0,
        settings_per_year: 0.0,
        pumps_per_year: 0.0,
    };
    let typical = of_strength(1.0);
    let rows = [
        ("none", of_strength(0.0)),
        ("strength 0.5", of_strength(0.5)),
        ("strength 1", typical),
        ("strength 2", of_strength(2.0)),
        ("membranes", ChangeOptions { membranes_per_year: typical.membranes_per_year, ..none }),
        ("feed", ChangeOptions { feeds_per_year: typical.feeds_per_year, ..none }),
        ("sensors", ChangeOptions { sensors_per_year: typical.sensors_per_year, ..none }),
        ("settings", ChangeOptions { settings_per_year: typical.settings_per_year, ..none }),
        ("pumps", ChangeOptions { pumps_per_year: typical.pumps_per_year, ..none }),
    ];
    println!("| change | {} | all sensors |\n|---|---|---|---|---|", ROLES.join(" | "));
    for (name, change) in rows {
        let mut sums = [0.0; 4];
        for seed in 0..seeds {
            for (sum, value) in sums.iter_mut().zip(shifts(seed, change)?) {
                *sum += value / seeds as f64;
            }
        }
        println!("| {name} | {} |", sums.map(|mean| format!("{mean:.3}")).join(" | "));
    }
    Ok(())
}

fn of_strength(strength: f64) -> ChangeOptions {
    ChangeOptions { strength, ..ChangeOptions::default() }
}

/// Returns the distances for the three roles, and the mean over all sensors.
fn shifts(seed: u64, change: ChangeOptions) -> Result<[f64; 4], Box<dyn std::error::Error>> {
    let options = PlantOptions {
        days: 2.0 * YEAR_DAYS,
        period: Period::from_secs(3600.0).ok_or("a period")?,
        seed: Seed::new(seed),
        change,
        ..PlantOptions::default()
    };
    let plant = Plant::new(options)?;
    // Names of sensors have no suffix after a point.
    let sensors: Vec<usize> = (0..plant.schema().len())
        .filter(|&at| !plant.schema()[at].name.contains('.') && plant.schema()[at].name != "MODE")
        .collect();
    let mut years = [vec![Vec::new(); sensors.len()], vec![Vec::new(); sensors.len()]];
    for day in plant {
        let year = &mut years[usize::from(f64::from(day.day) >= YEAR_DAYS)];
        for (values, &channel) in year.iter_mut().zip(&sensors) {
            values.extend(day.columns[channel].iter().filter(|value| !value.is_nan()));
        }
    }
    let [first, second] = &mut years;
    let all: Vec<f64> = first.iter_mut().zip(second).map(|(a, b)| distance(a, b)).collect();
    let all: Vec<f64> = all.into_iter().filter(|distance| distance.is_finite()).collect();
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    Ok([all[0], all[1], all[2], mean])
}

/// Returns the 1-Wasserstein distance by quantiles, in standard deviations of `a`; NaN if `a` is constant or empty.
fn distance(a: &mut [f32], b: &mut [f32]) -> f64 {
    a.sort_unstable_by(f32::total_cmp);
    b.sort_unstable_by(f32::total_cmp);
    if a.is_empty() || b.is_empty() {
        return f64::NAN;
    }
    let apart = (0..QUANTILES).map(|place| (quantile(a, place) - quantile(b, place)).abs());
    let mean = a.iter().copied().map(f64::from).sum::<f64>() / a.len() as f64;
    let square = a.iter().map(|&value| (f64::from(value) - mean).powi(2)).sum::<f64>();
    apart.sum::<f64>() / QUANTILES as f64 / (square / a.len() as f64).sqrt()
}

/// Returns the quantile number `place` of [`QUANTILES`].
fn quantile(sorted: &[f32], place: usize) -> f64 {
    f64::from(sorted[place * (sorted.len() - 1) / (QUANTILES - 1)])
}
