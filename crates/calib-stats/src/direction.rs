//! The direction in which a score improves.

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
    /// Returns the score as a cost: smaller is better.
    pub const fn cost(self, score: f64) -> f64 {
        match self {
            Self::LowerIsBetter => score,
            Self::HigherIsBetter => -score,
        }
    }

    /// Orders two scores, the better one first. Neither may be NaN. Zeros of both signs are equal.
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
}
