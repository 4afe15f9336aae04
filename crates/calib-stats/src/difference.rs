//! Differences of two means, paired where both have the same clusters.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::clustered::cluster_means;
use crate::error::{check_length, check_pair};
use crate::summary::{around, mean, sample_std, t_interval};
use crate::{Interval, StatsError};

/// The difference x − y of two samples of runs in clusters.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Difference {
    /// Mean of x minus mean of y; infinite if one of them is (`null` in files for +∞).
    #[serde(with = "crate::diverged")]
    #[schemars(with = "crate::diverged::Stored")]
    pub mean: f64,
    /// 95 % t-interval of the difference; `None` for fewer than two clusters or an infinite mean.
    pub interval: Option<Interval>,
    /// Number of clusters of x and of y; the same clusters if the difference is paired.
    pub clusters: [usize; 2],
    /// Number of clusters in which x is smaller, and in which y is; `None` if no clusters are shared.
    pub smaller: Option<[usize; 2]>,
}

impl Difference {
    /// Whether the interval excludes 0, so that one of the two is clearly smaller. False without an interval.
    pub fn is_told(&self) -> bool {
        self.interval.is_some_and(|interval| interval.low > 0.0 || interval.high < 0.0)
    }
}

/// Returns the mean difference of `x` and `y` `[pairs]`. `clusters` `[pairs]` gives the cluster of each pair.
///
/// With d, the mean difference of the pairs in each of the G clusters: mean = Σd / G, interval mean ± t₀.₉₇₅(G − 1) ·
/// s(d) / √G. Properties of a cluster (such as a start state from which every model deviates far) affect both x and y
/// and cancel. A cluster counts for x or for y by the sign of its d. Source: the paired t-test, over means of clusters
/// as in [`summarise_clusters`](crate::summarise_clusters).
///
/// # Errors
///
/// An input is empty, holds NaN, has another length, or infinities meet.
pub fn paired_difference<K: Ord>(
    clusters: &[K],
    x: &[f64],
    y: &[f64],
) -> Result<Difference, StatsError> {
    check_pair(("x", x), ("y", y))?;
    check_length("clusters of the pairs", clusters.len(), x.len())?;
    let differences: Vec<f64> = x.iter().zip(y).map(|(x, y)| x - y).collect();
    if differences.iter().any(|difference| difference.is_nan()) {
        return Err(StatsError::OpposedInfinities { what: "differences of pairs" });
    }
    let own = means_of_clusters(clusters, &differences)?;
    let mean = mean(&own)?;
    let interval = sample_std(&own)?.and_then(|std| t_interval(mean, std, own.len()));
    let smaller = [
        own.iter().filter(|&&difference| difference < 0.0).count(),
        own.iter().filter(|&&difference| difference > 0.0).count(),
    ];
    Ok(Difference { mean, interval, clusters: [own.len(); 2], smaller: Some(smaller) })
}

/// Returns the difference of the means of two samples that share no clusters, each given as (clusters, runs).
///
/// With the means of clusters, their variances s² and numbers G of both: x̄ − ȳ ± t₀.₉₇₅(ν) · √(s²ₓ / Gₓ + s²ᵧ / Gᵧ),
/// where ν is that of Welch (1947) and Satterthwaite: (a + b)² / (a² / (Gₓ − 1) + b² / (Gᵧ − 1)) for a = s²ₓ / Gₓ, b =
/// s²ᵧ / Gᵧ. Properties of clusters do not cancel here, so the interval is wider than a paired one.
///
/// # Errors
///
/// As [`paired_difference`], for each sample.
pub fn unpaired_difference<K: Ord>(
    (clusters_of_x, x): (&[K], &[f64]),
    (clusters_of_y, y): (&[K], &[f64]),
) -> Result<Difference, StatsError> {
    let x = means_of_clusters(clusters_of_x, x)?;
    let y = means_of_clusters(clusters_of_y, y)?;
    let difference = mean(&x)? - mean(&y)?;
    if difference.is_nan() {
        return Err(StatsError::OpposedInfinities { what: "means of two samples" });
    }
    let interval = sample_std(&x)?.zip(sample_std(&y)?).and_then(|(s_x, s_y)| {
        let a = s_x.powi(2) / x.len() as f64;
        let b = s_y.powi(2) / y.len() as f64;
        if a + b == 0.0 {
            return Some(Interval { low: difference, high: difference });
        }
        let freedom =
            (a + b).powi(2) / (a * a / (x.len() - 1) as f64 + b * b / (y.len() - 1) as f64);
        around(difference, (a + b).sqrt(), freedom)
    });
    Ok(Difference { mean: difference, interval, clusters: [x.len(), y.len()], smaller: None })
}

/// Returns the mean of each cluster, in the order of clusters.
fn means_of_clusters<K: Ord>(clusters: &[K], runs: &[f64]) -> Result<Vec<f64>, StatsError> {
    Ok(cluster_means(clusters, runs)?.into_iter().map(|(_, mean)| mean).collect())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::summarise_clusters;

    fn width(difference: Difference) -> f64 {
        difference.interval.unwrap().high - difference.interval.unwrap().low
    }

    #[test]
    fn what_starts_have_in_common_cancels() {
        // Start states differ by far more than models. x is smaller by 1, 2 and 3, with two ensemble members each.
        let clusters = [1, 1, 2, 2, 3, 3];
        let x = [10.0, 11.0, 50.0, 51.0, 90.0, 91.0];
        let y = [11.0, 12.0, 52.0, 53.0, 93.0, 94.0];
        let difference = paired_difference(&clusters, &x, &y).unwrap();
        // s = 1, t(2) = 4.302652730.
        let half = 4.302_652_730 / 3_f64.sqrt();
        assert!((difference.mean + 2.0).abs() < 1e-12);
        assert!((difference.interval.unwrap().low + 2.0 + half).abs() < 1e-8);
        assert_eq!((difference.clusters, difference.smaller), ([3, 3], Some([3, 0])));
        assert!(!difference.is_told());
        let unpaired = unpaired_difference((&clusters, &x), (&clusters, &y)).unwrap();
        assert!(width(unpaired) > 20.0 * width(difference));
    }

    #[test]
    fn a_difference_that_is_everywhere_the_same_is_told() {
        let difference = paired_difference(&[1, 2], &[1.0, 5.0], &[0.5, 4.5]).unwrap();
        assert_eq!(difference.interval, Some(Interval { low: 0.5, high: 0.5 }));
        assert!(difference.is_told());
        let equal = paired_difference(&[1, 2], &[1.0, 5.0], &[1.0, 5.0]).unwrap();
        assert_eq!((equal.is_told(), equal.smaller), (false, Some([0, 0])));
    }

    #[test]
    fn one_start_tells_nothing() {
        let difference = paired_difference(&[4, 4], &[1.0, 2.0], &[3.0, 5.0]).unwrap();
        assert_eq!((difference.mean, difference.interval), (-2.5, None));
        assert!(!difference.is_told());
        let unpaired = unpaired_difference((&[4], &[1.0]), (&[5, 6], &[2.0, 4.0])).unwrap();
        assert_eq!((unpaired.mean, unpaired.interval, unpaired.smaller), (-2.0, None, None));
    }

    #[test]
    fn samples_without_spread_have_an_interval_of_no_width() {
        let difference =
            unpaired_difference((&[1, 2], &[1.0, 1.0]), (&[3, 4], &[2.0, 2.0])).unwrap();
        assert_eq!(difference.interval, Some(Interval { low: -1.0, high: -1.0 }));
    }

    #[test]
    fn infinities_that_meet_are_an_error() {
        let inf = f64::INFINITY;
        let met = paired_difference(&[1], &[inf], &[inf]);
        assert_eq!(met, Err(StatsError::OpposedInfinities { what: "differences of pairs" }));
        let one = paired_difference(&[1, 2], &[inf, 1.0], &[1.0, 1.0]).unwrap();
        assert_eq!((one.mean, one.interval), (inf, None));
    }

    proptest! {
        #[test]
        fn swapped_models_have_the_difference_turned_round(
            pairs in prop::collection::vec((0u8..5, -9.0f64..9.0, -9.0f64..9.0), 2..30)
        ) {
            let clusters: Vec<u8> = pairs.iter().map(|pair| pair.0).collect();
            let x: Vec<f64> = pairs.iter().map(|pair| pair.1).collect();
            let y: Vec<f64> = pairs.iter().map(|pair| pair.2).collect();
            let one = paired_difference(&clusters, &x, &y).unwrap();
            let other = paired_difference(&clusters, &y, &x).unwrap();
            prop_assert_eq!(one.mean, -other.mean);
            prop_assert_eq!(one.interval.map(|interval| interval.low), other.interval.map(|interval| -interval.high));
            prop_assert_eq!(one.smaller.map(|[a, b]| [b, a]), other.smaller);
            // The paired mean is the difference of the summaries' means: both weight clusters equally.
            let means = [&x, &y].map(|runs| summarise_clusters(&clusters, runs).unwrap().mean);
            prop_assert!((one.mean - (means[0] - means[1])).abs() < 1e-9);
        }
    }
}
