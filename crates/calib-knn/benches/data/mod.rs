//! Generated states of known structure.

use std::f64::consts::TAU;

use calib_core::{Rng, Seed, States};

/// Returns values that are uniform in the unit cube.
pub(crate) fn uniform(rows: usize, columns: usize) -> States {
    let mut rng = Seed::new(1).rng();
    let values = (0..rows * columns).map(|_| rng.unit() as f32).collect();
    States::new(values, rows, columns).expect("valid")
}

/// Returns states of ten slow factors, one with a daily period, and a mode that shifts every
/// sensor.
pub(crate) fn plant(rows: usize, columns: usize) -> States {
    const FACTORS: usize = 10;
    let mut rng = Seed::new(3).rng();
    let loadings = normals(&mut rng, FACTORS * columns);
    let shifts = normals(&mut rng, 3 * columns);
    let mut factors = normals(&mut rng, FACTORS);
    let mut rng = Seed::new(4).rng();
    let mut values = Vec::with_capacity(rows * columns);
    for row in 0..rows {
        move_on(&mut factors, row, &mut rng);
        let mode = row / 180 % 3;
        for column in 0..columns {
            let mixed: f64 =
                (0..FACTORS).map(|f| factors[f] * loadings[f * columns + column]).sum();
            let value = mixed + 3.0 * shifts[mode * columns + column] + 0.02 * rng.normal();
            values.push(((value * 50.0).round() / 1000.0) as f32);
        }
    }
    States::new(values, rows, columns).expect("valid")
}

fn normals(rng: &mut Rng, count: usize) -> Vec<f64> {
    (0..count).map(|_| rng.normal()).collect()
}

/// Moves the factors to `row`. The first has the period of a day; the others change slowly and at
/// random.
fn move_on(factors: &mut [f64], row: usize, rng: &mut Rng) {
    for (number, factor) in factors.iter_mut().enumerate().skip(1) {
        let memory = 1.0 - 0.01 / number as f64;
        *factor = memory * *factor + (1.0 - memory * memory).sqrt() * rng.normal();
    }
    factors[0] = 2.0 * (TAU * row as f64 / 8640.0).sin();
}
