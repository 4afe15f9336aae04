//! Rank correlations.

use std::cmp::Ordering;

use crate::error::check_pair;
use crate::{StatsError, average_ranks};

/// Returns Spearman's ρ of `x` `[n]` and `y` `[n]`: Pearson's correlation of their average ranks.
///
/// Infinities are ordered like numbers. `None` where either input is constant (also n = 1). Source:
/// Spearman (1904), with average ranks for ties as in `scipy.stats.spearmanr`.
///
/// # Errors
///
/// The inputs are empty, differ in length, or hold NaN.
pub fn spearman(x: &[f64], y: &[f64]) -> Result<Option<f64>, StatsError> {
    check_pair(("x", x), ("y", y))?;
    let x = average_ranks(x)?;
    let y = average_ranks(y)?;
    // Average ranks of n numbers always have the mean (n + 1)/2.
    let centre = (x.len() + 1) as f64 / 2.0;
    let mut xy = 0.0;
    let mut xx = 0.0;
    let mut yy = 0.0;
    for (x, y) in x.iter().zip(&y) {
        xy += (x - centre) * (y - centre);
        xx += (x - centre).powi(2);
        yy += (y - centre).powi(2);
    }
    if xx == 0.0 || yy == 0.0 {
        return Ok(None);
    }
    Ok(Some((xy / (xx * yy).sqrt()).clamp(-1.0, 1.0)))
}

/// Returns Kendall's τ-b of `x` `[n]` and `y` `[n]`.
///
/// τ-b = (C − D) / √((P − `T_x`)(P − `T_y`)) with C concordant and D discordant pairs, P = n(n − 1)/2
/// pairs, and `T_x` and `T_y` pairs that are tied in x and in y. `None` where either input is constant
/// (also n = 1). All pairs are compared in O(n²) time: it is meant for grids of tens of values. Source:
/// Kendall (1945), the variant of `scipy.stats.kendalltau`.
///
/// # Errors
///
/// The inputs are empty, differ in length, or hold NaN.
pub fn kendall_tau_b(x: &[f64], y: &[f64]) -> Result<Option<f64>, StatsError> {
    check_pair(("x", x), ("y", y))?;
    let mut balance = 0i64;
    let mut differ_x = 0u64;
    let mut differ_y = 0u64;
    for i in 0..x.len() {
        for j in 0..i {
            let sx = sign(x[i], x[j]);
            let sy = sign(y[i], y[j]);
            balance += sx * sy;
            differ_x += u64::from(sx != 0);
            differ_y += u64::from(sy != 0);
        }
    }
    if differ_x == 0 || differ_y == 0 {
        return Ok(None);
    }
    let tau = balance as f64 / ((differ_x as f64).sqrt() * (differ_y as f64).sqrt());
    Ok(Some(tau.clamp(-1.0, 1.0)))
}

/// Returns the sign of a − b, for infinities as well.
fn sign(a: f64, b: f64) -> i64 {
    a.partial_cmp(&b).unwrap_or(Ordering::Equal) as i64
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn constant_input_has_no_correlation() {
        assert_eq!(spearman(&[1.0, 1.0], &[1.0, 2.0]), Ok(None));
        assert_eq!(kendall_tau_b(&[1.0, 2.0], &[3.0, 3.0]), Ok(None));
        assert_eq!(spearman(&[1.0], &[1.0]), Ok(None));
        assert_eq!(kendall_tau_b(&[f64::INFINITY; 3], &[1.0, 2.0, 3.0]), Ok(None));
    }

    #[test]
    fn diverged_values_count_as_the_largest() {
        let online = [0.1, 0.2, f64::INFINITY];
        assert_eq!(spearman(&[1.0, 2.0, 3.0], &online), Ok(Some(1.0)));
        assert_eq!(kendall_tau_b(&[3.0, 2.0, 1.0], &online), Ok(Some(-1.0)));
    }

    #[test]
    fn unequal_lengths_are_an_error() {
        let expected = Err(StatsError::LengthMismatch { what: "y", expected: 2, got: 1 });
        assert_eq!(spearman(&[1.0, 2.0], &[1.0]), expected);
        assert_eq!(kendall_tau_b(&[1.0, 2.0], &[1.0]), expected);
    }

    proptest! {
        #[test]
        fn correlations_are_symmetric_bounded_and_turn_with_the_sign(
            pairs in prop::collection::vec((-5i32..5, -5i32..5), 1..15)
        ) {
            let x: Vec<f64> = pairs.iter().map(|p| f64::from(p.0)).collect();
            let y: Vec<f64> = pairs.iter().map(|p| f64::from(p.1)).collect();
            let minus_y: Vec<f64> = y.iter().map(|y| -y).collect();
            for f in [spearman, kendall_tau_b] {
                let one = f(&x, &y).unwrap();
                let other = f(&y, &x).unwrap();
                let turned = f(&x, &minus_y).unwrap();
                prop_assert_eq!(one.is_some(), other.is_some());
                if let (Some(one), Some(other), Some(turned)) = (one, other, turned) {
                    prop_assert!((one - other).abs() < 1e-12);
                    prop_assert!((one + turned).abs() < 1e-12);
                    prop_assert!(one.abs() <= 1.0);
                }
                if let Some(own) = f(&x, &x).unwrap() {
                    prop_assert!((own - 1.0).abs() < 1e-12);
                }
            }
        }
    }
}
