//! How Student's t moves from look to look if there is nothing to find.
//!
//! Let x₁ … xₙ be independent N(0, σ²), S = Σx, Q = Σx², c = S / √Q. Then t = x̄ √n / s = c √((n − 1) / (n − c²)), which rises
//! with c. The direction of (x₁ … xₙ) is uniform on the sphere and independent of Q, so the next observation r = xₙ₊₁ / √Q has
//! √n r ~ t(n), independent of all c so far, and c' = (c + r) / √(1 + r²): a Markov chain without σ. With r = tan φ,
//! c' = c cos φ + sin φ, where φ has the density ∝ cosⁿ⁻¹ φ on (−π/2, π/2).
//!
//! H(y) = P(no boundary was crossed before look n, and c ≤ y). Where tests with c > b end at look n,
//! H'(y) = ∫ f(φ) H(min(b, (y − sin φ) / cos φ)) dφ is that of look n + 1.

use std::f64::consts::{FRAC_PI_2, PI};

/// Parts of the grid of angles θ, c = −√n cos θ, between which H is interpolated. With four times as many of these and of
/// the midpoints, boundaries of up to 60 looks change by less than 2 in 100,000.
const CELLS: usize = 400;

/// Midpoints of the integral over φ.
const POINTS: usize = 400;

/// The distribution of c after `n` observations, as far as the test has not ended.
pub(super) struct Null {
    n: usize,
    /// H at θ = i π / `CELLS`: from c = −√n to √n.
    below: Vec<f64>,
    /// The boundary of c, if one was set.
    limit: f64,
}

impl Null {
    /// With three observations the direction is uniform on a sphere in three dimensions, and c / √3 uniform from −1 to 1.
    pub(super) fn at_three() -> Self {
        let below = (0..=CELLS).map(|i| f64::midpoint(1.0, -(PI * i as f64 / CELLS as f64).cos()));
        Self { n: 3, below: below.collect(), limit: f64::INFINITY }
    }

    /// The boundary of t that is crossed with probability `rate`; tests that cross it end.
    pub(super) fn boundary(&mut self, rate: f64) -> f64 {
        let target = self.below[CELLS] - rate;
        let mut low = 0.0;
        let mut high = CELLS as f64;
        // A bisection to the last bit.
        for _ in 0..64 {
            let middle = f64::midpoint(low, high);
            if self.between(middle) < target { low = middle } else { high = middle }
        }
        let angle = PI * high / CELLS as f64;
        let n = self.n as f64;
        // c = −√n cos(angle), and t = c √((n − 1) / (n − c²)) = −√(n − 1) cot(angle).
        self.limit = -n.sqrt() * angle.cos();
        -(n - 1.0).sqrt() * angle.cos() / angle.sin()
    }

    /// After one more observation.
    pub(super) fn next(&self) -> Self {
        let root = (self.n as f64).sqrt();
        let steps: Vec<(f64, f64, f64)> = (0..POINTS)
            .map(|point| {
                let (sin, cos) = (PI * (point as f64 + 0.5) / POINTS as f64 - FRAC_PI_2).sin_cos();
                (sin, cos, cos.powi(self.n as i32 - 1))
            })
            .collect();
        let total: f64 = steps.iter().map(|(_, _, weight)| weight).sum();
        let next_root = ((self.n + 1) as f64).sqrt();
        Self {
            n: self.n + 1,
            below: (0..=CELLS)
                .map(|i: usize| {
                    let y = -next_root * (PI * i as f64 / CELLS as f64).cos();
                    steps
                        .iter()
                        .map(|&(sin, cos, weight): &(f64, f64, f64)| {
                            weight * self.at(((y - sin) / cos).min(self.limit) / root)
                        })
                        .sum::<f64>()
                        / total
                })
                .collect(),
            limit: f64::INFINITY,
        }
    }

    /// H where c is this share of √n.
    fn at(&self, share: f64) -> f64 {
        self.between((-share.clamp(-1.0, 1.0)).acos() / PI * CELLS as f64)
    }

    /// H at a place of the grid: the cubic through the four nodes around it.
    fn between(&self, place: f64) -> f64 {
        let cell = (place as usize).clamp(1, CELLS - 2);
        let x = place - cell as f64;
        let [a, b, c, d] = [0, 1, 2, 3].map(|node| self.below[cell + node - 1]);
        let left = x + 1.0;
        let right = x - 1.0;
        let beyond = x - 2.0;
        -a * x * right * beyond / 6.0 + b * left * right * beyond / 2.0
            - c * left * x * beyond / 2.0
            + d * left * x * right / 6.0
    }
}
