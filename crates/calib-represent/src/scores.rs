use std::ops::Range;

use calib_core::{Seed, Segments, States};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{distinct::count_distinct, eigen::symmetric_eigenvalues, split::successive};

/// Two states count as the same if their distance is below this fraction of the median distance of random
/// pairs.
pub const TOLERANCE: f64 = 1e-3;

/// Maximum number of evenly spaced states on which uniqueness is computed.
const MOST_DISTINCT: usize = 20_000;

/// A dimension is live if its second moment is at least this fraction of the largest one.
const ALIVE: f64 = 0.01;

/// Scores of a representation on states that it was not trained on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Scores {
    /// `(d_rand − d_succ)/d_rand`, at least 0: how much nearer successive states are than random ones.
    pub dynamics_awareness: f64,
    /// Distinct ψ / distinct states, at most 1: whether different states remain different.
    pub uniqueness: f64,
    /// Number of eigenvalues of the second moment `E[ψψᵀ]` that are at least 1 % of the largest.
    pub live_dimensions: usize,
    /// `d_succ`: mean ‖ψ(s) − ψ(s')‖ of successive states.
    pub successive_distance: f64,
    /// `d_rand`: mean ‖ψ(s) − ψ(s')‖ of an equal number of random pairs.
    pub random_distance: f64,
}

/// Scores ψ `[n, d]` of the states `[n, columns]` on the rows of `validation`.
///
/// - Dynamics awareness (name: paper; formula: public code) over all successive pairs and as many uniform
///   random pairs, drawn from `seed`. Without a finite, positive `d_rand` it is 0.
/// - Uniqueness (name: paper; formula: ours) on at most 20,000 evenly spaced rows. Rows are visited in
///   order. A row is distinct if no earlier distinct row is nearer than 1e-3 of the median distance of the
///   random pairs. Distinct states are counted in the same way.
/// - Live dimensions (derived from the loss): the number of eigenvalues of Σ ψψᵀ / rows that are at least 1
///   % of the largest.
///
/// # Panics
/// If the states and their ψ differ in number, or the validation part has no two successive states.
pub fn score(
    states: &States,
    psi: &States,
    segments: &Segments,
    validation: &Range<usize>,
    seed: Seed,
) -> Scores {
    assert_eq!(states.rows(), psi.rows(), "ψ of every state");
    let next: Vec<(usize, usize)> =
        successive(segments, validation).map(|row| (row, row + 1)).collect();
    assert!(!next.is_empty(), "the split has checked it");
    let mut rng = seed.child("random pairs").rng();
    let mut random: Vec<(usize, usize)> = Vec::with_capacity(next.len());
    for _ in &next {
        let [first, second] =
            std::array::from_fn(|_| validation.start + rng.below(validation.len()));
        random.push((first, second));
    }

    let successive_distance = mean(&distances(psi, &next));
    let random_distances = distances(psi, &random);
    let random_distance = mean(&random_distances);
    let awareness = (random_distance - successive_distance) / random_distance;

    let rows = evenly(validation, MOST_DISTINCT);
    let of_psi = count_distinct(psi, &rows, TOLERANCE * median(random_distances));
    let of_states = count_distinct(states, &rows, TOLERANCE * median(distances(states, &random)));
    Scores {
        // NaN and negative values become 0.
        dynamics_awareness: awareness.max(0.0),
        uniqueness: (of_psi as f64 / of_states as f64).min(1.0),
        live_dimensions: live_dimensions(psi, validation),
        successive_distance,
        random_distance,
    }
}

/// Returns the Euclidean distance between two rows.
pub(crate) fn distance(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt()
}

fn distances(states: &States, pairs: &[(usize, usize)]) -> Vec<f64> {
    pairs.iter().map(|&(a, b)| distance(states.row(a), states.row(b))).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Returns at most `most` evenly spaced rows of a range.
fn evenly(rows: &Range<usize>, most: usize) -> Vec<usize> {
    let count = rows.len().min(most);
    (0..count).map(|place| rows.start + place * rows.len() / count).collect()
}

fn live_dimensions(psi: &States, rows: &Range<usize>) -> usize {
    let d = psi.columns();
    let mut moment = vec![0.0; d * d];
    for row in rows.clone() {
        let psi = psi.row(row);
        for (i, &a) in psi.iter().enumerate() {
            for (sum, &b) in moment[i * d..].iter_mut().zip(&psi[..=i]) {
                *sum += f64::from(a) * f64::from(b);
            }
        }
    }
    for i in 0..d {
        for j in 0..i {
            moment[j * d + i] = moment[i * d + j];
        }
    }
    let values = symmetric_eigenvalues(&moment, d);
    values.iter().filter(|&&value| value > 0.0 && value >= ALIVE * values[0]).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn states(values: Vec<f32>, columns: usize) -> States {
        let rows = values.len() / columns;
        States::new(values, rows, columns).expect("finite")
    }

    /// Returns a slow rotation around a circle.
    fn circle() -> (States, Segments) {
        let angles = (0..400_u16).map(|row| f32::from(row) * 0.05);
        let values = angles.flat_map(|angle| [angle.cos(), angle.sin()]).collect();
        (states(values, 2), Segments::from_lengths([400]).expect("valid"))
    }

    #[test]
    fn a_faithful_slow_representation_scores_high() {
        let (circle, segments) = circle();
        let scores = score(&circle, &circle, &segments, &(200..400), Seed::new(1));
        // A chord of 0.05 compared with the mean chord 4/π.
        let expected = 1.0 - 0.05 / (4.0 / std::f64::consts::PI);
        assert!((scores.dynamics_awareness - expected).abs() < 0.01, "{scores:?}");
        assert_eq!((scores.uniqueness, scores.live_dimensions), (1.0, 2));
    }

    #[test]
    fn collapsed_and_random_representations_score_low() {
        let (circle, segments) = circle();
        let constant = states(vec![0.5; 800], 2);
        let scores = score(&circle, &constant, &segments, &(200..400), Seed::new(1));
        assert_eq!(scores.dynamics_awareness, 0.0);
        assert_eq!((scores.uniqueness, scores.live_dimensions), (1.0 / 200.0, 1));
        let mut rng = Seed::new(3).rng();
        let noise = states((0..800).map(|_| rng.normal() as f32).collect(), 2);
        let scores = score(&circle, &noise, &segments, &(200..400), Seed::new(1));
        assert!(scores.dynamics_awareness < 0.1, "{scores:?}");
        // Every second state has the code of the previous one.
        let halves = (0..400).flat_map(|row| circle.row(row / 2 * 2).to_vec()).collect();
        let scores = score(&circle, &states(halves, 2), &segments, &(200..400), Seed::new(1));
        assert_eq!(scores.uniqueness, 0.5);
    }
}
