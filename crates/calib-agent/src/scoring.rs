use std::ops::Range;

use crate::{AgentError, truncation_horizon};

/// Which steps of a run count for its error.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum Scoring {
    /// Every step whose return is known (the paper's sums run over all steps).
    #[default]
    WholeRun,
    /// The last part of the run, as a fraction of its steps in (0, 1]; the usual one is 0.25.
    Final(f64),
}

impl Scoring {
    /// Check that some step of an unbroken stream of `steps` steps can be scored.
    ///
    /// # Errors
    /// [`AgentError::NothingToScore`] if none can.
    pub fn check(self, gamma: f64, steps: usize) -> Result<(), AgentError> {
        let (whole, first) = (0..steps, self.first_step(steps)?);
        if known_returns(&whole, gamma).end > first {
            return Ok(());
        }
        let horizon = truncation_horizon(gamma).max(1);
        Err(AgentError::NothingToScore { gamma, horizon, pieces: 1, longest: steps, first, steps })
    }

    /// First step of a run of `steps` that counts: ⌊steps · (1 − fraction)⌉.
    pub(crate) fn first_step(self, steps: usize) -> Result<usize, AgentError> {
        match self {
            Self::WholeRun => Ok(0),
            Self::Final(fraction) if fraction > 0.0 && fraction <= 1.0 => {
                Ok((steps as f64 * (1.0 - fraction)).round() as usize)
            }
            Self::Final(got) => Err(AgentError::ScoredFraction { got }),
        }
    }
}

/// The steps of `piece` whose returns are known: all but the last H, and never the last,
/// from which nothing follows.
pub(crate) fn known_returns(piece: &Range<usize>, gamma: f64) -> Range<usize> {
    let unknown = truncation_horizon(gamma).max(1);
    piece.start..piece.end.saturating_sub(unknown).max(piece.start)
}

/// Count, mean and standard deviation (divided by n) of the returns that are scored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ScoredReturns {
    pub(crate) steps: usize,
    pub(crate) mean: f64,
    pub(crate) std: f64,
}

impl ScoredReturns {
    /// Statistics of the scored steps of `returns`.
    pub(crate) fn new(
        returns: &[f64],
        pieces: &[Range<usize>],
        gamma: f64,
        first: usize,
    ) -> Result<Self, AgentError> {
        let scored = || {
            pieces.iter().flat_map(|piece| {
                let known = known_returns(piece, gamma);
                &returns[known.start.max(first).min(known.end)..known.end]
            })
        };
        let steps = scored().count();
        if steps == 0 {
            return Err(AgentError::NothingToScore {
                gamma,
                horizon: truncation_horizon(gamma).max(1),
                pieces: pieces.len(),
                longest: pieces.iter().map(Range::len).max().unwrap_or(0),
                first,
                steps: returns.len(),
            });
        }
        let mean = scored().sum::<f64>() / steps as f64;
        let variance = scored().map(|g| (g - mean).powi(2)).sum::<f64>() / steps as f64;
        Ok(Self { steps, mean, std: variance.sqrt() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_that_are_too_short_are_known_beforehand() {
        // H = 459 for γ = 0.99: the last quarter must be longer.
        assert!(Scoring::Final(0.25).check(0.99, 4 * 459).is_err());
        assert!(Scoring::Final(0.25).check(0.99, 4 * 459 + 4).is_ok());
        assert!(Scoring::WholeRun.check(0.99, 459).is_err());
        assert!(Scoring::WholeRun.check(0.99, 460).is_ok());
    }

    #[test]
    fn a_final_fraction_begins_where_it_says() {
        assert_eq!(Scoring::WholeRun.first_step(100), Ok(0));
        assert_eq!(Scoring::Final(0.25).first_step(100), Ok(75));
        assert_eq!(Scoring::Final(1.0).first_step(100), Ok(0));
        assert_eq!(Scoring::Final(0.25).first_step(3), Ok(2));
        for got in [0.0, 1.5, -0.25] {
            let error = Scoring::Final(got).first_step(10);
            assert_eq!(error, Err(AgentError::ScoredFraction { got }));
        }
    }

    #[test]
    fn truncated_returns_never_count() {
        assert_eq!(known_returns(&(10..30), 0.5), 10..23);
        assert_eq!(known_returns(&(10..30), 0.0), 10..29);
        assert_eq!(known_returns(&(10..12), 0.5), 10..10);
        let returns: Vec<f64> = (0..30).map(f64::from).collect();
        // 0..10 knows 0..3, 10..30 knows 10..23; scoring begins at 20: 20, 21, 22.
        let pieces = [0..10, 10..30];
        let scored = ScoredReturns::new(&returns, &pieces, 0.5, 20).expect("some");
        assert_eq!((scored.steps, scored.mean), (3, 21.0));
        assert!((scored.std - (2.0_f64 / 3.0).sqrt()).abs() < 1e-12);
        let scored = ScoredReturns::new(&returns, &pieces, 0.5, 0).expect("some");
        assert_eq!(scored.steps, 16);
    }

    #[test]
    fn nothing_to_score_says_what_to_do() {
        let pieces = [0..5, 5..10];
        let error = ScoredReturns::new(&[0.0; 10], &pieces, 0.9, 8).expect_err("too short");
        assert_eq!(
            error.to_string(),
            "no step can be scored: with gamma = 0.9 the last 44 steps of each unbroken piece have \
             truncated returns, the longest of 2 pieces has 5 steps, and scoring begins at step 8 of 10; \
             use longer streams, a smaller gamma, or score the whole run"
        );
    }
}
