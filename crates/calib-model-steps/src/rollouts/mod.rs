//! Rollouts, and their distances from the record.

pub mod collapse;
pub mod comparison;
mod cost;
pub mod figures;
pub mod one_step;
pub mod rollout;
pub mod trajectory_columns;
pub(crate) mod truth;

use calib_base::StepError;

/// Iterates over every two of these, in their order.
fn every_two<T>(all: &[T]) -> impl Iterator<Item = (&T, &T)> {
    let each = all.iter().enumerate();
    each.flat_map(move |(place, one)| all[place + 1..].iter().map(move |other| (one, other)))
}

/// Returns the place of the smallest of these numbers, and the places of all without a clear difference from it.
/// `is_told` returns whether there is a clear difference between two places.
fn not_worse(
    numbers: &[(usize, f64)],
    is_told: impl Fn(usize, usize) -> Result<bool, StepError>,
) -> Result<Vec<usize>, StepError> {
    let smallest = numbers.iter().min_by(|(_, one), (_, other)| one.total_cmp(other));
    let Some(&(best, _)) = smallest else { return Ok(Vec::new()) };
    let mut all = Vec::new();
    for &(place, _) in numbers {
        if place == best || !is_told(place, best)? {
            all.push(place);
        }
    }
    Ok(all)
}
