//! Measures of how well a choice did in the held-out period (Online).

use crate::error::check;
use crate::{Direction, StatsError, competition_ranks};

/// Returns whether value `chosen` is among the `k` best of `online` `[values]`. Ties count in its
/// favour.
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
        assert_eq!(top_k_hit(&[0.1, 0.2], 2, 1, LOWER), Err(error));
    }
}
