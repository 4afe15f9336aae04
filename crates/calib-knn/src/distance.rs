//! The definition of distance, and an error bound for its fast f32 approximation.

/// Returns the squared Euclidean distance: `Σ_c (a_c − b_c)²` in f64, summed in column order.
///
/// This is the definition that every index must reproduce. Neighbours are ordered by it, ties by row.
pub(crate) fn squared(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).fold(0.0, |sum, (&a, &b)| {
        let difference = f64::from(a) - f64::from(b);
        sum + difference * difference
    })
}

/// Returns [`squared`] of four pairs at once: four sums side by side, each in column order.
pub(crate) fn squared_of_four(a: &[f32], b: [&[f32]; 4]) -> [f64; 4] {
    let mut sums = [0.0; 4];
    let [p, q, r, s] = b;
    for ((((&a, &p), &q), &r), &s) in a.iter().zip(p).zip(q).zip(r).zip(s) {
        for (sum, b) in sums.iter_mut().zip([p, q, r, s]) {
            let difference = f64::from(a) - f64::from(b);
            *sum += difference * difference;
        }
    }
    sums
}

/// Returns the distance that tables store.
pub(crate) fn stored(squared: f64) -> f32 {
    (squared.sqrt() as f32).min(f32::MAX)
}

/// An error bound that converts between [`squared`] and its f32 approximation.
///
/// A sum of `d` terms `fl(fl(a − b)²)` in f32, in any order and with or without fused multiplication, is
/// within a factor `1 ± (d + 3)u/(1 − (d + 3)u)`, `u = 2⁻²⁴`, of the exact sum, apart from underflow of less
/// than `f32::MIN_POSITIVE` per term (Higham 2002, §3.1). The f64 sum of the definition errs by
/// `(d + 3)·2⁻⁵³`. Twice the first factor covers both.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Margin {
    relative: f64,
    absolute: f64,
}

impl Margin {
    /// Returns the margin for states of `columns` columns.
    pub(crate) fn new(columns: usize) -> Self {
        let columns = columns as f64;
        Self {
            relative: (columns + 4.0) * f64::from(f32::EPSILON),
            absolute: (columns + 4.0) * f64::from(f32::MIN_POSITIVE),
        }
    }

    /// Returns an upper bound on [`squared`] from its f32 approximation.
    pub(crate) fn upper(self, approximation: f32) -> f64 {
        if approximation == f32::INFINITY {
            return f64::INFINITY;
        }
        f64::from(approximation) * (1.0 + self.relative) + self.absolute
    }

    /// Returns a number `t` such that every pair with `squared ≤ bound` has an f32 approximation `≤ t`.
    pub(crate) fn threshold(self, bound: f64) -> f32 {
        // `as` rounds to nearest, or to infinity beyond the largest f32.
        ((bound * (1.0 + self.relative) + self.absolute) as f32).next_up()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn approximate(a: &[f32], b: &[f32]) -> f32 {
        a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
    }

    proptest! {
        #[test]
        fn the_threshold_holds_at_every_scale(
            values in proptest::collection::vec((-1.0_f32..1.0, -1.0_f32..1.0), 1..200),
            exponent in -30_i32..19,
        ) {
            let scale = 10_f32.powi(exponent);
            let (a, b): (Vec<f32>, Vec<f32>) =
                values.iter().map(|(a, b)| (a * scale, b * scale)).unzip();
            let margin = Margin::new(a.len());
            prop_assert!(approximate(&a, &b) <= margin.threshold(squared(&a, &b)));
            prop_assert!(squared(&a, &b) <= margin.upper(approximate(&a, &b)));
        }
    }

    #[test]
    fn four_at_once_are_four_in_turn() {
        let mut rng = calib_core::Seed::new(1).rng();
        let rows: Vec<Vec<f32>> =
            (0..5).map(|_| (0..37).map(|_| rng.normal() as f32).collect()).collect();
        let four = [&rows[1][..], &rows[2], &rows[3], &rows[4]];
        assert_eq!(squared_of_four(&rows[0], four), four.map(|row| squared(&rows[0], row)));
    }

    #[test]
    fn overflow_and_underflow_stay_candidates() {
        let margin = Margin::new(2);
        let far = ([f32::MAX, 0.0], [-f32::MAX, 0.0]);
        assert!(approximate(&far.0, &far.1) <= margin.threshold(squared(&far.0, &far.1)));
        let near = ([1e-42_f32, 0.0], [0.0, 1e-42]);
        assert!(approximate(&near.0, &near.1) <= margin.threshold(squared(&near.0, &near.1)));
        assert_eq!(margin.threshold(f64::INFINITY), f32::INFINITY);
        assert_eq!(stored(squared(&far.0, &far.1)), f32::MAX);
    }
}
