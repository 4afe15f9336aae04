//! How good a choice turned out to be Online.

use crate::error::check;
use crate::{Direction, StatsError, competition_ranks};

/// What choosing value `chosen` costs Online, relative to the best value of `online` `[values]`.
///
/// regret = (`online[chosen]` − best) / |best| where lower is better, (best − `online[chosen]`) / |best| where
/// higher is. 0 = the best value was chosen; 0.05 = 5 % worse; +∞ = the chosen value diverged, or best is 0
/// and the chosen value is not. `None` where every value diverged.
/// Source: the usual relative simple regret; our choice.
///
/// # Errors
///
/// `online` is empty or holds NaN, or `chosen` is out of range.
pub fn regret(
    online: &[f64],
    chosen: usize,
    direction: Direction,
) -> Result<Option<f64>, StatsError> {
    let score = chosen_score(online, chosen)?;
    let Some(best) = online.iter().copied().min_by(|&a, &b| direction.compare(a, b)) else {
        return Ok(None);
    };
    if best.is_infinite() {
        return Ok(None);
    }
    let loss = direction.cost(score) - direction.cost(best);
    Ok(Some(if loss == 0.0 { 0.0 } else { loss / best.abs() }))
}

/// Whether value `chosen` is among the `k` best of `online` `[values]`, ties counting in its favour.
///
/// A value that diverged is never among the best.
///
/// # Errors
///
/// `online` is empty or holds NaN, or `chosen` is out of range.
pub fn top_k_hit(
    online: &[f64],
    chosen: usize,
    k: usize,
    direction: Direction,
) -> Result<bool, StatsError> {
    let score = chosen_score(online, chosen)?;
    Ok(score.is_finite() && competition_ranks(online, direction)?[chosen] <= k)
}

fn chosen_score(online: &[f64], chosen: usize) -> Result<f64, StatsError> {
    const WHAT: &str = "online scores";
    check(WHAT, online)?;
    online.get(chosen).copied().ok_or(StatsError::OutOfRange {
        what: WHAT,
        index: chosen,
        len: online.len(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const INF: f64 = f64::INFINITY;
    const LOWER: Direction = Direction::LowerIsBetter;
    const HIGHER: Direction = Direction::HigherIsBetter;

    #[test]
    fn regret_is_relative_to_the_best() {
        let online = [0.5, 0.4, INF];
        assert!((regret(&online, 0, LOWER).unwrap().unwrap() - 0.25).abs() < 1e-15);
        assert_eq!(regret(&online, 1, LOWER), Ok(Some(0.0)));
        assert_eq!(regret(&online, 2, LOWER), Ok(Some(INF)));
        assert_eq!(regret(&[-10.0, -8.0], 0, HIGHER), Ok(Some(0.25)));
    }

    #[test]
    fn regret_of_degenerate_grids() {
        assert_eq!(regret(&[INF, INF], 0, LOWER), Ok(None));
        assert_eq!(regret(&[0.0, 0.0], 1, LOWER), Ok(Some(0.0)));
        assert_eq!(regret(&[0.0, 0.1], 1, LOWER), Ok(Some(INF)));
    }

    #[test]
    fn top_k_counts_ties_in_favour_but_never_a_diverged_value() {
        let online = [0.3, 0.1, 0.3, INF];
        assert_eq!(top_k_hit(&online, 0, 1, LOWER), Ok(false));
        assert_eq!(top_k_hit(&online, 0, 2, LOWER), Ok(true));
        assert_eq!(top_k_hit(&online, 2, 2, LOWER), Ok(true));
        assert_eq!(top_k_hit(&online, 3, 4, LOWER), Ok(false));
        assert_eq!(top_k_hit(&[1.0, 2.0], 1, 1, HIGHER), Ok(true));
    }

    #[test]
    fn a_value_outside_the_grid_is_an_error() {
        let error = StatsError::OutOfRange { what: "online scores", index: 2, len: 2 };
        assert_eq!(regret(&[0.1, 0.2], 2, LOWER), Err(error.clone()));
        assert_eq!(top_k_hit(&[0.1, 0.2], 2, 1, LOWER), Err(error));
    }
}
