use calib_core::Stream;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::scoring::ScoredReturns;

/// Returns the Monte-Carlo returns `G_t = Σ_k γᵏ o_{t+k+1}` of state column `cumulant`, for every step of the stream,
/// by the recursion `G_t = o_{t+1} + γ G_{t+1}` inside each unbroken piece.
///
/// Sums end with their piece: the last step of a piece has return 0. Do not compare the last [`truncation_horizon`](crate::truncation_horizon)
/// steps of a piece with predictions.
pub fn discounted_returns(stream: &dyn Stream, cumulant: usize, gamma: f64) -> Vec<f64> {
    let mut returns = vec![0.0; stream.len()];
    for piece in stream.pieces() {
        let mut following = 0.0;
        for t in piece.clone().rev().skip(1) {
            following = f64::from(stream.state(t + 1)[cumulant]) + gamma * following;
            returns[t] = following;
        }
    }
    returns
}

/// Count, mean and standard deviation of the returns of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ReturnMoments {
    /// Steps whose returns are known.
    pub steps: usize,
    /// Mean of these returns.
    pub mean: f64,
    /// Standard deviation of these returns, divisor n.
    pub std: f64,
}

impl ReturnMoments {
    /// Returns the moments of the returns of column `cumulant` for `gamma`, as [`discounted_returns`] computes them.
    /// Steps at the ends of pieces, whose returns are truncated, are excluded. `None` if there is no other step.
    ///
    /// # Panics
    /// As [`truncation_horizon`](crate::truncation_horizon).
    pub fn of(stream: &dyn Stream, cumulant: usize, gamma: f64) -> Option<Self> {
        let returns = discounted_returns(stream, cumulant, gamma);
        let ScoredReturns { steps, mean, std } =
            ScoredReturns::new(&returns, stream.pieces(), gamma, 0..stream.len())?;
        Some(Self { steps, mean, std })
    }
}

#[cfg(test)]
mod tests {
    use calib_core::{RowStream, Segments, States};
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn moments_leave_out_what_is_cut_off() {
        let states = States::new((0..20_u8).map(f32::from).collect(), 20, 1).expect("valid");
        let segments = Segments::from_lengths([12, 8]).expect("valid");
        let stream = RowStream::replay(states, &segments);
        // γ = 0: the return is the next value, known except at the last step of each piece.
        let moments = ReturnMoments::of(&stream, 0, 0.0).expect("some");
        assert_eq!((moments.steps, moments.mean), (18, (66.0 + 112.0) / 18.0));
        // γ = 0.5 cuts off seven steps of each piece.
        assert_eq!(ReturnMoments::of(&stream, 0, 0.5).expect("some").steps, 6);
        assert_eq!(ReturnMoments::of(&stream, 0, 0.9), None);
    }

    proptest! {
        #[test]
        fn the_recursion_is_the_sum(
            values in prop::collection::vec(-1.0_f32..1.0, 1..60),
            cuts in prop::collection::vec(1_usize..20, 1..8),
            gamma in 0.0_f64..0.99,
        ) {
            // Pieces of the drawn lengths. The last one takes the rest.
            let mut lengths = vec![];
            let mut left = values.len();
            for cut in cuts {
                if cut < left {
                    lengths.push(cut);
                    left -= cut;
                }
            }
            lengths.push(left);
            let rows = values.len();
            let states = States::new(values.clone(), rows, 1).expect("valid");
            let segments = Segments::from_lengths(lengths.clone()).expect("valid");
            let returns = discounted_returns(&RowStream::replay(states, &segments), 0, gamma);
            let mut start = 0;
            for length in lengths {
                let end = start + length;
                for (t, got) in returns[start..end].iter().enumerate() {
                    let expected: f64 = (start + t + 1..end)
                        .map(|u| gamma.powi((u - start - t - 1) as i32) * f64::from(values[u]))
                        .sum();
                    prop_assert!((got - expected).abs() < 1e-9);
                }
                start = end;
            }
        }
    }
}
