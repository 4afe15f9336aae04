//! Intervals from resamples, and of observations that come in clusters.

use crate::{Interval, StatsError, quantile};

/// 95 % interval of a statistic of `clusters` clusters, by the percentile bootstrap.
///
/// Each of `resamples` times as many clusters as there are are drawn with replacement, and the statistic is taken of
/// all their observations: sensors of one plant are not independent, plants are. The interval runs from the 0.025 to
/// the 0.975 quantile of what it was. Resamples in which the statistic is not defined do not count.
/// `None` for fewer than two clusters, and where half of the resamples or more are undefined or any is infinite.
///
/// `draw(n)` returns a number below `n`, evenly; `statistic` is given the drawn clusters by their numbers.
/// Source: Efron (1979); clusters as units as in Field & Welsh (2007).
///
/// # Errors
///
/// A statistic is NaN.
pub fn cluster_interval(
    clusters: usize,
    resamples: usize,
    mut draw: impl FnMut(usize) -> usize,
    statistic: impl Fn(&[usize]) -> Option<f64>,
) -> Result<Option<Interval>, StatsError> {
    if clusters < 2 {
        return Ok(None);
    }
    let mut drawn = vec![0; clusters];
    let mut values = Vec::with_capacity(resamples);
    for _ in 0..resamples {
        drawn.fill_with(|| draw(clusters));
        values.push(statistic(&drawn));
    }
    if values.iter().flatten().any(|value| value.is_infinite()) {
        return Ok(None);
    }
    percentile_interval(&values)
}

/// From the 0.025 to the 0.975 quantile of what a statistic was in each resample, `None` where it was not defined; an end may be
/// infinite. `None` where half of the resamples or more are undefined.
fn percentile_interval(resamples: &[Option<f64>]) -> Result<Option<Interval>, StatsError> {
    let values: Vec<f64> = resamples.iter().flatten().copied().collect();
    if 2 * values.len() <= resamples.len() {
        return Ok(None);
    }
    Ok(Some(Interval { low: quantile(&values, 0.025)?, high: quantile(&values, 0.975)? }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All n^n samples of n clusters, one after the other.
    fn all_samples(clusters: usize) -> impl FnMut(usize) -> usize {
        let mut call = 0;
        move |n| {
            let (sample, place) = (call / clusters, call % clusters);
            call += 1;
            sample / n.pow(place as u32) % n
        }
    }

    #[test]
    fn the_exact_distribution_of_two_clusters() {
        // Means of {0, 1} with replacement: 0, 0.5, 0.5, 1. Type-7 quantiles: 0.025 · 3 = 0.075 of the way to 0.5.
        let values = [0.0, 1.0];
        let mean = |drawn: &[usize]| Some(drawn.iter().map(|&d| values[d]).sum::<f64>() / 2.0);
        let interval = cluster_interval(2, 4, all_samples(2), mean).unwrap().unwrap();
        assert!((interval.low - 0.0375).abs() < 1e-15, "{interval:?}");
        assert!((interval.high - 0.9625).abs() < 1e-15, "{interval:?}");
    }

    #[test]
    fn undefined_resamples_do_not_count_but_must_not_prevail() {
        // Of the four samples of two clusters, (0, 0) is undefined: 0.5, 0.5, 1 are left.
        let of = |undefined: &'static [usize]| {
            let statistic = move |drawn: &[usize]| {
                let sum: usize = drawn.iter().sum();
                (!undefined.contains(&sum)).then_some(sum as f64 / 2.0)
            };
            cluster_interval(2, 4, all_samples(2), statistic).unwrap()
        };
        let interval = of(&[0]).unwrap();
        assert!((interval.low - 0.5).abs() < 1e-15);
        assert!((interval.high - 0.975).abs() < 1e-15, "0.95 of the way from 0.5 to 1");
        assert_eq!(of(&[1]), None, "half of them");
    }

    #[test]
    fn one_cluster_or_an_infinite_statistic_has_no_interval() {
        assert_eq!(cluster_interval(1, 9, |_| 0, |_| Some(1.0)), Ok(None));
        let infinite = |drawn: &[usize]| Some(if drawn[0] == 0 { f64::INFINITY } else { 1.0 });
        assert_eq!(cluster_interval(2, 4, all_samples(2), infinite), Ok(None));
    }
}
