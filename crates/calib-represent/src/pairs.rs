use calib_core::{Rng, Segments};

/// Draws pairs of states that are a truncated-geometric number of steps apart, inside segments.
///
/// `u` is uniform over the states that have a later one in their segment. It begins a sub-trajectory of at most
/// T states. `v` is τ steps later. P(τ) ∝ κ^(τ−1) on 1 … T−1, or on the rest of the segment if that is shorter.
/// (The numbers are from the paper, and the truncation from the public code. That `u` begins the sub-trajectory
/// is our choice, which omits no state.)
#[derive(Clone, Debug)]
pub struct PairSampler {
    /// Rows that may be `u`, as runs: cumulative count before the run, first row, one past the last row of the
    /// segment.
    runs: Vec<(usize, usize, usize)>,
    /// Number of rows that may be `u`.
    pairs: usize,
    log_kappa: f64,
    longest: usize,
}

impl PairSampler {
    /// Creates a sampler over the rows of `segments` that are in `rows`.
    ///
    /// Returns `None` if no segment has two rows there.
    ///
    /// # Panics
    /// If `kappa` is not in (0, 1] or `trajectory` is below 2.
    pub fn new(
        segments: &Segments,
        rows: std::ops::Range<usize>,
        kappa: f64,
        trajectory: usize,
    ) -> Option<Self> {
        assert!(kappa > 0.0 && kappa <= 1.0 && trajectory >= 2, "checked with the configuration");
        let mut runs = Vec::new();
        let mut pairs = 0;
        for segment in segments.iter() {
            let start = segment.rows().start.max(rows.start);
            let end = segment.rows().end.min(rows.end);
            if start + 1 < end {
                runs.push((pairs, start, end));
                pairs += end - 1 - start;
            }
        }
        let log_kappa = kappa.ln();
        (pairs > 0).then_some(Self { runs, pairs, log_kappa, longest: trajectory - 1 })
    }

    /// Draws the rows (u, v) of a pair.
    pub fn draw(&self, rng: &mut Rng) -> (usize, usize) {
        let place = rng.below(self.pairs);
        let run = self.runs.partition_point(|&(before, ..)| before <= place) - 1;
        let (before, start, end) = self.runs[run];
        let u = start + (place - before);
        let most = self.longest.min(end - 1 - u);
        (u, u + self.steps(most, rng.unit()))
    }

    /// Returns the τ in 1..=most at which the cumulative distribution (1 − κ^τ)/(1 − κ^most) reaches `unit`.
    fn steps(&self, most: usize, unit: f64) -> usize {
        let steps = if self.log_kappa == 0.0 {
            (unit * most as f64) as usize
        } else {
            let share = -(self.log_kappa * most as f64).exp_m1();
            ((-unit * share).ln_1p() / self.log_kappa) as usize
        };
        steps.min(most - 1) + 1
    }

    /// Returns P(τ) for τ = 1, 2, …, T−1, for a segment that is long enough.
    pub fn probabilities(&self) -> Vec<f64> {
        let weights: Vec<f64> =
            (0..self.longest).map(|steps| (self.log_kappa * steps as f64).exp()).collect();
        let sum: f64 = weights.iter().sum();
        weights.into_iter().map(|weight| weight / sum).collect()
    }
}

#[cfg(test)]
mod tests {
    use calib_core::Seed;

    use super::*;

    #[test]
    fn pairs_stay_inside_segments_and_range() {
        let segments = Segments::from_lengths([4, 1, 30, 9]).expect("valid");
        let sampler = PairSampler::new(&segments, 2..40, 0.9, 6).expect("has pairs");
        assert_eq!(sampler.pairs, 1 + 29 + 4);
        let mut rng = Seed::new(1).rng();
        let mut seen = [0_u32; 44];
        for _ in 0..50_000 {
            let (u, v) = sampler.draw(&mut rng);
            assert!(u < v && v - u <= 5 && u >= 2 && v < 40, "{u} {v}");
            assert_eq!(segments.position_of(u), segments.position_of(v));
            seen[u] += 1;
        }
        let expected = 50_000.0 / 34.0;
        for (row, &count) in seen.iter().enumerate() {
            let begins = row == 2 || (5..34).contains(&row) || (35..39).contains(&row);
            let error = (f64::from(count) - if begins { expected } else { 0.0 }).abs();
            assert!(error < 5.0 * expected.sqrt() && (begins || count == 0), "{row}: {count}");
        }
        let short = Segments::from_lengths([1, 1]).expect("valid");
        assert!(PairSampler::new(&short, 0..2, 0.9, 6).is_none());
    }

    #[test]
    fn times_apart_are_truncated_geometric() {
        for kappa in [0.6, 0.95, 1.0] {
            let segments = Segments::from_lengths([5_000]).expect("valid");
            let sampler = PairSampler::new(&segments, 0..5_000, kappa, 8).expect("has pairs");
            let mut rng = Seed::new(2).rng();
            let mut counts = [0_u32; 8];
            let draws = 200_000;
            for _ in 0..draws {
                let (u, v) = sampler.draw(&mut rng);
                counts[v - u] += 1;
            }
            let probabilities = sampler.probabilities();
            assert!((probabilities[1] / probabilities[0] - kappa).abs() < 1e-12);
            for (steps, probability) in probabilities.iter().enumerate() {
                let share = f64::from(counts[steps + 1]) / f64::from(draws);
                assert!((share - probability).abs() < 0.006, "{kappa} {steps}: {share}");
            }
        }
    }
}
