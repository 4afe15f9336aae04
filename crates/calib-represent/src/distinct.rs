use std::collections::HashMap;

use calib_core::{Seed, States};

/// Number of random directions on which rows are projected.
const DIRECTIONS: usize = 3;

/// Returns the number of distinct `rows`. A row counts if it is no nearer than `tolerance` to an earlier row
/// that counts. Exact repeats never count.
///
/// Two rows are at least as far apart as their projections on any unit vector. Three projections form a grid
/// of cells as wide as the tolerance. So candidates are in the same cell or an adjacent one. The directions
/// are random, but they only save time: the count does not depend on them.
pub(crate) fn count_distinct(states: &States, rows: &[usize], tolerance: f64) -> usize {
    let directions = directions(states.columns());
    // The cells are a little wider, because the projections are rounded.
    let width = if tolerance > 0.0 { tolerance * (1.0 + 1e-6) } else { f64::MIN_POSITIVE };
    let limit = tolerance * tolerance;
    let mut counted: HashMap<[i64; DIRECTIONS], Vec<usize>> = HashMap::new();
    let mut distinct = 0;
    for &row in rows {
        let own = directions.each_ref().map(|direction| {
            let along: f64 = states
                .row(row)
                .iter()
                .zip(direction)
                .map(|(value, weight)| f64::from(*value) * weight)
                .sum();
            (along / width).floor() as i64
        });
        let mut candidates = around(own).filter_map(|cell| counted.get(&cell)).flatten();
        if !candidates.any(|&other| is_near(states.row(row), states.row(other), limit)) {
            distinct += 1;
            counted.entry(own).or_default().push(row);
        }
    }
    distinct
}

fn directions(columns: usize) -> [Vec<f64>; DIRECTIONS] {
    let mut rng = Seed::new(0).child("directions").rng();
    std::array::from_fn(|_| {
        let direction: Vec<f64> = (0..columns).map(|_| rng.normal()).collect();
        let norm = direction.iter().map(|value| value * value).sum::<f64>().sqrt();
        direction.into_iter().map(|value| value / norm).collect()
    })
}

/// Returns a cell, followed by the adjacent ones.
fn around(cell: [i64; DIRECTIONS]) -> impl Iterator<Item = [i64; DIRECTIONS]> {
    const NEAR: [i64; 3] = [0, -1, 1];
    (0..NEAR.len().pow(DIRECTIONS as u32)).map(move |mut number| {
        cell.map(|coordinate| {
            let beside = NEAR[number % NEAR.len()];
            number /= NEAR.len();
            coordinate.saturating_add(beside)
        })
    })
}

/// Whether the squared distance is below `limit`, or zero.
fn is_near(a: &[f32], b: &[f32], limit: f64) -> bool {
    let mut squares = 0.0;
    for (a, b) in a.chunks(8).zip(b.chunks(8)) {
        squares += a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
        if squares >= limit && squares > 0.0 {
            return false;
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scores::distance;

    #[test]
    fn agrees_with_comparing_all_pairs() {
        let mut rng = Seed::new(5).rng();
        let values: Vec<f32> = (0..600).map(|_| rng.normal() as f32).collect();
        let states = States::new(values, 200, 3).expect("finite");
        let rows: Vec<usize> = (0..200).chain(10..40).collect();
        for tolerance in [0.0, 0.1, 0.5, 2.0] {
            let mut kept: Vec<usize> = Vec::new();
            for &row in &rows {
                let is_near_one = kept.iter().any(|&other| {
                    let distance = distance(states.row(row), states.row(other));
                    distance < tolerance || distance == 0.0
                });
                if !is_near_one {
                    kept.push(row);
                }
            }
            assert_eq!(count_distinct(&states, &rows, tolerance), kept.len(), "{tolerance}");
        }
    }
}
