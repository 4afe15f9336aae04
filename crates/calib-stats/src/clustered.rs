//! Means of clustered runs.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::error::{check, check_length};
use crate::summary::{mean, summarise};
use crate::{Interval, StatsError, Summary};

/// The mean of runs that come in clusters. Runs of one cluster have something in common that runs of others lack, such
/// as the start state, and are not independent evidence.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ClusterSummary {
    /// Number of runs.
    pub runs: usize,
    /// Number of clusters, which is the sample size.
    pub clusters: usize,
    /// Number of runs that are infinite, that is, diverged.
    pub diverged: usize,
    /// Mean over clusters of the mean over their runs; infinite if any run is (`null` in files for +∞).
    #[serde(with = "crate::diverged")]
    #[schemars(with = "crate::diverged::Stored")]
    pub mean: f64,
    /// Sample standard deviation of the cluster means (divisor G − 1); `None` for one cluster or an infinite mean.
    pub std: Option<f64>,
    /// 95 % t-interval of the mean; `None` for one cluster or an infinite mean.
    pub interval: Option<Interval>,
}

/// Summarises `runs` `[runs]`. `clusters` `[runs]` gives the cluster of each run.
///
/// With the means m of the G clusters: mean = Σm / G, std = √(Σ(m − mean)² / (G − 1)), interval = mean ± t₀.₉₇₅(G − 1)
/// · std / √G. Clusters count equally, however many runs they have.
///
/// If all clusters have equally many runs, the mean is that of all runs. The interval is then the cluster-robust one
/// (Liang & Zeger 1986) with the finite-sample factor G / (G − 1) and quantiles of t(G − 1), as Cameron & Miller
/// (2015, section VI) recommend for few clusters. If sizes or spreads differ, the interval of the clusters' own means
/// keeps its level (Ibragimov & Müller 2010), which the robust one does not. The choice between the two is ours.
///
/// # Errors
///
/// `runs` is empty, holds NaN or infinities of both signs, or `clusters` has another length.
pub fn summarise_clusters<K: Ord>(
    clusters: &[K],
    runs: &[f64],
) -> Result<ClusterSummary, StatsError> {
    let means: Vec<f64> =
        cluster_means(clusters, runs)?.into_iter().map(|(_, mean)| mean).collect();
    let Summary { mean, std, interval, .. } = summarise(&means)?;
    Ok(ClusterSummary {
        runs: runs.len(),
        clusters: means.len(),
        diverged: runs.iter().filter(|run| run.is_infinite()).count(),
        mean,
        std,
        interval,
    })
}

/// Returns the mean of each cluster's runs, in the order of the clusters.
///
/// # Errors
///
/// As [`summarise_clusters`].
pub fn cluster_means<'a, K: Ord>(
    clusters: &'a [K],
    runs: &[f64],
) -> Result<Vec<(&'a K, f64)>, StatsError> {
    check("runs", runs)?;
    check_length("clusters of the runs", clusters.len(), runs.len())?;
    let mut all: BTreeMap<&K, Vec<f64>> = BTreeMap::new();
    for (cluster, &run) in clusters.iter().zip(runs) {
        all.entry(cluster).or_default().push(run);
    }
    all.into_iter().map(|(cluster, runs)| Ok((cluster, mean(&runs)?))).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Returns the mean and half the width of the interval.
    fn told(summary: &ClusterSummary) -> (f64, Option<f64>) {
        (summary.mean, summary.interval.map(|interval| (interval.high - interval.low) / 2.0))
    }

    #[test]
    fn members_of_one_start_are_one_observation() {
        // Two start states, three ensemble members each: means 2 and 4, standard deviation sqrt 2, t(1) =
        // 12.706204736.
        let runs = [1.0, 2.0, 3.0, 3.0, 4.0, 5.0];
        let summary = summarise_clusters(&["a", "a", "a", "b", "b", "b"], &runs).unwrap();
        assert_eq!((summary.runs, summary.clusters), (6, 2));
        let (mean, half) = told(&summary);
        assert!((mean - 3.0).abs() < 1e-12);
        assert!((half.unwrap() - 12.706_204_736).abs() < 1e-6, "{half:?}");
    }

    #[test]
    fn one_cluster_has_no_interval_of_no_width() {
        let summary = summarise_clusters(&[7, 7, 7], &[0.5; 3]).unwrap();
        assert_eq!((summary.mean, summary.std, summary.interval), (0.5, None, None));
    }

    #[test]
    fn equal_runs_of_several_clusters_have_an_interval_of_no_width() {
        let summary = summarise_clusters(&[1, 1, 2, 3], &[0.5; 4]).unwrap();
        assert_eq!(told(&summary), (0.5, Some(0.0)));
    }

    #[test]
    fn clusters_count_alike_whatever_their_size() {
        let summary = summarise_clusters(&[1, 1, 1, 2], &[1.0, 1.0, 1.0, 3.0]).unwrap();
        assert_eq!((summary.mean, summary.std), (2.0, Some(2_f64.sqrt())));
    }

    #[test]
    fn an_infinite_run_leaves_no_interval() {
        let summary = summarise_clusters(&[1, 1, 2], &[1.0, f64::INFINITY, 2.0]).unwrap();
        assert_eq!((summary.mean, summary.std, summary.diverged), (f64::INFINITY, None, 1));
        let text = serde_json::to_string(&summary).unwrap();
        assert_eq!(serde_json::from_str::<ClusterSummary>(&text).unwrap(), summary);
    }

    #[test]
    fn bad_input_is_an_error() {
        let none: [u8; 0] = [];
        assert_eq!(summarise_clusters(&none, &[]), Err(StatsError::Empty { what: "runs" }));
        assert!(matches!(
            summarise_clusters(&[1], &[1.0, 2.0]),
            Err(StatsError::LengthMismatch { expected: 2, got: 1, .. })
        ));
        assert!(matches!(
            summarise_clusters(&[1, 2], &[1.0, f64::NAN]),
            Err(StatsError::NotANumber { index: 1, .. })
        ));
    }

    /// Returns the summary of runs with their clusters.
    fn summary(runs: &[(u8, f64)]) -> ClusterSummary {
        let (clusters, values): (Vec<u8>, Vec<f64>) = runs.iter().copied().unzip();
        summarise_clusters(&clusters, &values).unwrap()
    }

    proptest! {
        /// Clusters of single runs give the result without clusters.
        #[test]
        fn clusters_of_one_run_are_runs(runs in prop::collection::vec(-9.0f64..9.0, 2..20)) {
            let clusters: Vec<usize> = (0..runs.len()).collect();
            let (own, plain) = (summarise_clusters(&clusters, &runs).unwrap(), summarise(&runs).unwrap());
            prop_assert_eq!((own.mean, own.std, own.interval), (plain.mean, plain.std, plain.interval));
        }

        /// With equal sizes: V = G / (G - 1) Σ_g (Σ_i e_gi)² / n², where e are the residuals from the mean of all
        /// runs.
        #[test]
        fn equal_clusters_have_the_robust_standard_error(
            table in (2usize..6, 1usize..5).prop_flat_map(|(clusters, size)| {
                prop::collection::vec(prop::collection::vec(-9.0f64..9.0, size), clusters)
            })
        ) {
            let runs = table.concat();
            let clusters: Vec<usize> = table
                .iter()
                .enumerate()
                .flat_map(|(cluster, runs)| vec![cluster; runs.len()])
                .collect();
            let summary = summarise_clusters(&clusters, &runs).unwrap();
            let (n, g) = (runs.len() as f64, table.len() as f64);
            let mean = runs.iter().sum::<f64>() / n;
            let squares =
                table.iter().map(|runs| runs.iter().map(|run| run - mean).sum::<f64>().powi(2));
            let robust = (g / (g - 1.0) * squares.sum::<f64>()).sqrt() / n;
            prop_assert!((summary.mean - mean).abs() < 1e-9);
            prop_assert!((summary.std.unwrap() / g.sqrt() - robust).abs() < 1e-9);
        }

        /// The order of the runs does not matter.
        #[test]
        fn the_order_of_runs_does_not_matter(
            mut runs in prop::collection::vec((0u8..4, -9.0f64..9.0), 1..20)
        ) {
            let before = summary(&runs);
            runs.reverse();
            let after = summary(&runs);
            prop_assert!((before.mean - after.mean).abs() < 1e-9);
            prop_assert_eq!((before.runs, before.clusters), (after.runs, after.clusters));
        }
    }
}
