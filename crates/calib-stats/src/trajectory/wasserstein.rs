use super::check_finite;
use crate::StatsError;

/// Returns the 1-Wasserstein distance of the values of two samples `x` `[n]` and `y` `[m]`, in
/// their unit: how far, on average, mass has to be moved to turn one histogram into the other.
///
/// W₁ = ∫ |F⁻¹(u) − G⁻¹(u)| du over 0 < u < 1, with the empirical quantile functions F⁻¹, G⁻¹; for
/// n = m the mean of |x₍ᵢ₎ − y₍ᵢ₎| over the sorted values. The order of the values does not matter.
/// Source: Ramdas, Trillos and Cuturi, *On Wasserstein two-sample testing*, 2017.
///
/// # Errors
///
/// A sample is empty, or holds NaN or an infinity.
///
/// ```
/// assert_eq!(calib_stats::wasserstein(&[3.0, 1.0], &[2.0, 5.0])?, 1.5);
/// # Ok::<(), calib_stats::StatsError>(())
/// ```
pub fn wasserstein(x: &[f64], y: &[f64]) -> Result<f64, StatsError> {
    check_finite("x", x)?;
    check_finite("y", y)?;
    let x = sorted(x);
    let y = sorted(y);
    let n = x.len();
    let m = y.len();
    // [0, 1] is cut into n m pieces: the quantile of x changes every m pieces, that of y every n.
    let mut at = 0;
    let mut sum = 0.0;
    while at < n * m {
        let i = at / m;
        let j = at / n;
        let next = ((i + 1) * m).min((j + 1) * n);
        sum += (next - at) as f64 * (x[i] - y[j]).abs();
        at = next;
    }
    Ok(sum / (n * m) as f64)
}

fn sorted(values: &[f64]) -> Vec<f64> {
    let mut values = values.to_vec();
    values.sort_unstable_by(f64::total_cmp);
    values
}

/// Returns the changes from each value to the next: `[n]` → `[n − 1]`.
pub fn increments(values: &[f64]) -> Vec<f64> {
    values.windows(2).map(|pair| pair[1] - pair[0]).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Returns ∫ |F(t) − G(t)| dt, the other form of the same distance.
    fn by_distribution_functions(x: &[f64], y: &[f64]) -> f64 {
        let all = sorted(&[x, y].concat());
        let pieces = all.windows(2);
        pieces.map(|t| (share(x, t[0]) - share(y, t[0])).abs() * (t[1] - t[0])).sum()
    }

    /// Returns the share of values up to t, F(t).
    fn share(values: &[f64], t: f64) -> f64 {
        values.iter().filter(|&&value| value <= t).count() as f64 / values.len() as f64
    }

    fn sample() -> impl Strategy<Value = Vec<f64>> {
        proptest::collection::vec(-3.0..3.0, 1..20)
    }

    proptest! {
        #[test]
        fn both_forms_agree(x in sample(), y in sample()) {
            let distance = wasserstein(&x, &y).unwrap();
            prop_assert!((distance - by_distribution_functions(&x, &y)).abs() < 1e-12);
        }

        #[test]
        fn a_shift_is_its_own_distance(x in sample(), shift in -5.0..5.0_f64) {
            let moved: Vec<f64> = x.iter().map(|value| value + shift).collect();
            prop_assert!((wasserstein(&x, &moved).unwrap() - shift.abs()).abs() < 1e-12);
            let (steps, of_moved) = (increments(&x), increments(&moved));
            if !steps.is_empty() {
                prop_assert!(wasserstein(&steps, &of_moved).unwrap() < 1e-12);
            }
        }
    }

    #[test]
    fn what_is_no_sample_is_refused() {
        assert_eq!(wasserstein(&[], &[1.0]), Err(StatsError::Empty { what: "x" }));
        let infinite = wasserstein(&[1.0], &[1.0, f64::INFINITY]);
        assert_eq!(infinite, Err(StatsError::Infinite { what: "y", index: 1 }));
    }
}
