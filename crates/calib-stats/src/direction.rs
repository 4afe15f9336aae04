//! Which way a score improves.

use std::cmp::Ordering;

use serde::{Deserialize, Serialize};

/// Whether a lower or a higher score is better.
///
/// Errors (NRMSE) are lower-is-better, discounted returns (paper, general formulation) higher-is-better.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// Errors and costs.
    #[default]
    LowerIsBetter,
    /// Returns and rewards.
    HigherIsBetter,
}

impl Direction {
    /// The score of a diverged run: +∞ where lower is better, −∞ where higher is better.
    pub const fn worst(self) -> f64 {
        match self {
            Self::LowerIsBetter => f64::INFINITY,
            Self::HigherIsBetter => f64::NEG_INFINITY,
        }
    }

    /// `score` where it is finite, otherwise [`worst`](Self::worst): the score of a run that may have diverged.
    pub const fn or_worst(self, score: f64) -> f64 {
        if score.is_finite() { score } else { self.worst() }
    }

    /// The score as something to be made small.
    pub const fn cost(self, score: f64) -> f64 {
        match self {
            Self::LowerIsBetter => score,
            Self::HigherIsBetter => -score,
        }
    }

    /// Orders two scores, the better one first. Neither may be NaN; zeros of both signs are equal.
    pub fn compare(self, a: f64, b: f64) -> Ordering {
        self.cost(a).partial_cmp(&self.cost(b)).unwrap_or(Ordering::Equal)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_better_score_comes_first() {
        assert_eq!(Direction::LowerIsBetter.compare(1.0, 2.0), Ordering::Less);
        assert_eq!(Direction::HigherIsBetter.compare(1.0, 2.0), Ordering::Greater);
        assert_eq!(Direction::HigherIsBetter.compare(0.0, -0.0), Ordering::Equal);
    }

    #[test]
    fn a_diverged_run_is_worse_than_any_finite_one() {
        for direction in [Direction::LowerIsBetter, Direction::HigherIsBetter] {
            for score in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                assert_eq!(direction.compare(f64::MAX, direction.or_worst(score)), Ordering::Less);
                assert_eq!(direction.compare(f64::MIN, direction.or_worst(score)), Ordering::Less);
            }
        }
        assert_eq!(Direction::HigherIsBetter.or_worst(3.0), 3.0);
    }
}
