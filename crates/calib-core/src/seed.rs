use rand_pcg::{
    Pcg64,
    rand_core::{Rng as _, SeedableRng as _},
};
use serde::{Deserialize, Serialize};

/// A named source of randomness. Seeds are derived, never drawn from the environment:
/// `Seed::new(7).child("rollout").number(3)` is the same on every machine and thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Seed(u64);

impl Seed {
    /// Returns the root seed that a user writes in a study.
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Returns the seed's number, for storage with results.
    pub const fn get(self) -> u64 {
        self.0
    }

    /// Returns the seed of the part called `name`.
    #[must_use]
    pub fn child(self, name: &str) -> Self {
        self.derive(b"name", name.as_bytes())
    }

    /// Returns the seed of part `number`.
    #[must_use]
    pub fn number(self, number: u64) -> Self {
        self.derive(b"number", &number.to_le_bytes())
    }

    /// Returns a generator that starts from this seed.
    pub fn rng(self) -> Rng {
        Rng(Pcg64::seed_from_u64(self.0))
    }

    fn derive(self, kind: &[u8], part: &[u8]) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&self.0.to_le_bytes()).update(kind).update(part);
        let mut seed = [0; 8];
        hasher.finalize_xof().fill(&mut seed);
        Self(u64::from_le_bytes(seed))
    }
}

/// PCG XSL RR 128/64 (O'Neill 2014). The distributions are defined here, so that
/// stored results do not change when a dependency changes its sampling.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Rng(Pcg64);

impl Rng {
    /// Returns 64 uniform bits.
    pub fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// Returns a uniform number in `[0, 1)` with 53 random bits.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    /// Returns a uniform number in `[low, high)`.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Returns a uniform integer in `0..n` without bias (Lemire 2019).
    ///
    /// # Panics
    /// If `n` is zero.
    pub fn below(&mut self, n: usize) -> usize {
        assert!(n > 0, "cannot draw from an empty range");
        let n = n as u64;
        loop {
            let product = u128::from(self.bits()) * u128::from(n);
            let low = product as u64;
            if low >= n || low >= n.wrapping_neg() % n {
                return (product >> 64) as usize;
            }
        }
    }

    /// Returns a standard normal number (Marsaglia's polar method, one of the pair).
    pub fn normal(&mut self) -> f64 {
        loop {
            let x = self.uniform(-1.0, 1.0);
            let y = self.uniform(-1.0, 1.0);
            let square = x * x + y * y;
            if square > 0.0 && square < 1.0 {
                return x * (-2.0 * square.ln() / square).sqrt();
            }
        }
    }

    /// Returns an exponential number with mean 1.
    pub fn exponential(&mut self) -> f64 {
        -(1.0 - self.unit()).ln()
    }

    /// Puts `items` in uniformly random order (Fisher–Yates).
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            items.swap(last, self.below(last + 1));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_are_stable() {
        // Stored results depend on these numbers: a change here is a change of format.
        let seed = Seed::new(7).child("rollout").number(3);
        assert_eq!(seed, Seed::new(7).child("rollout").number(3));
        assert_ne!(seed, Seed::new(7).child("rollout").number(4));
        assert_ne!(Seed::new(7).child("a").child("b"), Seed::new(7).child("ab"));
        let mut rng = Seed::new(7).rng();
        let draws: Vec<usize> = (0..8).map(|_| rng.below(100)).collect();
        assert_eq!(draws, STABLE_DRAWS);
    }

    const STABLE_DRAWS: [usize; 8] = [0, 23, 90, 83, 49, 59, 8, 32];

    #[test]
    fn draws_have_their_moments() {
        let mut rng = Seed::new(1).rng();
        let n = 200_000;
        let normal: Vec<f64> = (0..n).map(|_| rng.normal()).collect();
        let mean = normal.iter().sum::<f64>() / f64::from(n);
        let variance = normal.iter().map(|x| x * x).sum::<f64>() / f64::from(n);
        assert!(mean.abs() < 0.01 && (variance - 1.0).abs() < 0.02, "{mean} {variance}");
        let mut counts = [0_u32; 7];
        for _ in 0..n {
            counts[rng.below(7)] += 1;
        }
        let expected = f64::from(n) / 7.0;
        let chi_square: f64 =
            counts.iter().map(|&count| (f64::from(count) - expected).powi(2) / expected).sum();
        assert!(chi_square < 22.5, "chi-square {chi_square} with 6 degrees of freedom");
        let exponential = (0..n).map(|_| rng.exponential()).sum::<f64>() / f64::from(n);
        assert!((exponential - 1.0).abs() < 0.02);
    }

    #[test]
    fn a_shuffle_keeps_the_items() {
        let mut items: Vec<usize> = (0..50).collect();
        Seed::new(2).rng().shuffle(&mut items);
        assert!(items.windows(2).any(|pair| pair[0] > pair[1]));
        items.sort_unstable();
        assert_eq!(items, (0..50).collect::<Vec<_>>());
    }
}
