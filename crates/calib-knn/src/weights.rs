use calib_core::Rng;

/// The probabilities with which a step draws one of its `k` neighbours, at distances `d_1 ≤ … ≤ d_k`.
///
/// | name | probability of neighbour `j` | source |
/// |---|---|---|
/// | `Linear` | `(1 − d_j/Σd)/(k − 1)`; 1 if `k = 1`; `1/k` if `Σd = 0` | public code of the paper's group; the edge cases are derived |
/// | `Uniform` | `1/k` | our choice |
/// | `Softmax` | `∝ exp(−d_j/T)` | our choice |
/// | `Inverse` | `∝ 1/d_j`; uniform over the zeros if there are any | our choice |
/// | `Rank` | `∝ 1/j` | Lall & Sharma 1996, with `k = √n` |
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Weights {
    /// The weight falls linearly with the share of the distance.
    #[default]
    Linear,
    /// All weights are equal.
    Uniform,
    /// Boltzmann weights.
    Softmax {
        /// `T`, in units of distance; positive.
        temperature: f64,
    },
    /// The weight is the inverse distance.
    Inverse,
    /// The weight is the inverse rank among the neighbours, independent of the distances.
    Rank,
}

impl Weights {
    /// Returns the probabilities of neighbours at `distances`, which sum to 1.
    pub fn probabilities(self, distances: &[f32]) -> Vec<f64> {
        let raw: Vec<f64> = self.unnormalised(distances).collect();
        let total: f64 = raw.iter().sum();
        raw.into_iter().map(|weight| weight / total).collect()
    }

    /// Draws a position in `distances`, with one uniform random number per draw.
    ///
    /// # Panics
    /// If `distances` is empty.
    pub fn draw(self, distances: &[f32], rng: &mut Rng) -> usize {
        assert!(!distances.is_empty(), "there is a neighbour to draw");
        let total: f64 = self.unnormalised(distances).sum();
        let mut left = rng.unit() * total;
        let mut last = 0;
        for (position, weight) in self.unnormalised(distances).enumerate() {
            if weight > 0.0 {
                last = position;
                if left < weight {
                    return position;
                }
                left -= weight;
            }
        }
        // Rounding can exceed the total. Then the last neighbour with a positive weight is drawn.
        last
    }

    /// Returns which of the neighbours at `distances` a step can draw.
    pub(crate) fn possible(self, distances: &[f32]) -> impl Iterator<Item = bool> + '_ {
        self.unnormalised(distances).map(|weight| weight > 0.0)
    }

    pub(crate) fn draws_all(self, distances: &[f32]) -> bool {
        self.possible(distances).all(|possible| possible)
    }

    fn unnormalised(self, distances: &[f32]) -> impl Iterator<Item = f64> + '_ {
        let sum: f64 = distances.iter().copied().map(f64::from).sum();
        let nearest = distances.iter().copied().fold(f32::INFINITY, f32::min);
        let single = distances.len() == 1;
        distances.iter().enumerate().map(move |(place, &distance)| {
            let distance = f64::from(distance);
            match self {
                Self::Linear if single || sum == 0.0 => 1.0,
                Self::Linear => 1.0 - distance / sum,
                Self::Uniform => 1.0,
                Self::Softmax { temperature } => {
                    (-(distance - f64::from(nearest)) / temperature).exp()
                }
                Self::Inverse if nearest == 0.0 => f64::from(u8::from(distance == 0.0)),
                // The weights are relative to the nearest, so that tiny distances cannot overflow.
                Self::Inverse => f64::from(nearest) / distance,
                Self::Rank => 1.0 / (place + 1) as f64,
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use calib_core::Seed;

    use super::*;

    const ALL: [Weights; 5] = [
        Weights::Linear,
        Weights::Uniform,
        Weights::Softmax { temperature: 2.0 },
        Weights::Inverse,
        Weights::Rank,
    ];

    fn close(got: &[f64], expected: &[f64]) {
        assert_eq!(got.len(), expected.len());
        for (got, expected) in got.iter().zip(expected) {
            assert!((got - expected).abs() < 1e-12, "{got} {expected}");
        }
    }

    #[test]
    fn linear_weights_are_the_formula() {
        close(&Weights::Linear.probabilities(&[1.0, 2.0, 5.0]), &[0.4375, 0.375, 0.1875]);
        // A self-match at distance 0 gets 1/(k - 1): with k = 3 at least half of all draws.
        close(&Weights::Linear.probabilities(&[0.0, 3.0, 3.0]), &[0.5, 0.25, 0.25]);
        close(&Weights::Linear.probabilities(&[0.0, 2.0]), &[1.0, 0.0]);
    }

    #[test]
    fn other_weights_are_their_formulas() {
        let soft = Weights::Softmax { temperature: 2.0 }.probabilities(&[0.0, 2.0]);
        let e = (-1.0_f64).exp();
        close(&soft, &[1.0 / (1.0 + e), e / (1.0 + e)]);
        close(&Weights::Inverse.probabilities(&[1.0, 3.0]), &[0.75, 0.25]);
        close(&Weights::Inverse.probabilities(&[0.0, 0.0, 3.0]), &[0.5, 0.5, 0.0]);
        close(
            &Weights::Rank.probabilities(&[0.0, 0.0, 3.0]),
            &[6.0 / 11.0, 3.0 / 11.0, 2.0 / 11.0],
        );
    }

    #[test]
    fn edge_cases_are_uniform_or_certain() {
        for weights in ALL {
            close(&weights.probabilities(&[7.0]), &[1.0]);
            // `Rank` depends only on the order, so it is not uniform here.
            if weights == Weights::Rank {
                continue;
            }
            close(&weights.probabilities(&[0.0; 4]), &[0.25; 4]);
            close(&weights.probabilities(&[1e-40, 1e-40]), &[0.5; 2]);
        }
    }

    #[test]
    fn draws_follow_the_probabilities() {
        let distances = [0.5_f32, 1.0, 1.5, 4.0];
        for (number, weights) in ALL.into_iter().enumerate() {
            let mut rng = Seed::new(11).number(number as u64).rng();
            let mut counts = [0_u32; 4];
            let n = 100_000;
            for _ in 0..n {
                counts[weights.draw(&distances, &mut rng)] += 1;
            }
            let chi_square: f64 = weights
                .probabilities(&distances)
                .iter()
                .zip(counts)
                .map(|(p, count)| {
                    let expected = p * f64::from(n);
                    (f64::from(count) - expected).powi(2) / expected
                })
                .sum();
            // The 0.999 quantile with 3 degrees of freedom.
            assert!(chi_square < 16.3, "{weights:?}: chi-square {chi_square}");
        }
    }

    #[test]
    fn impossible_neighbours_are_never_drawn() {
        let mut rng = Seed::new(3).rng();
        for _ in 0..10_000 {
            assert_eq!(Weights::Linear.draw(&[0.0, 2.0], &mut rng), 0);
            assert!(Weights::Inverse.draw(&[0.0, 0.0, 1.0], &mut rng) < 2);
        }
    }
}
