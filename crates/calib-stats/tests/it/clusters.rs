//! Reference values from NumPy and `SciPy` for the output of a small run. They are made by
//! `scripts/golden/clusters.py`.

use calib_stats::{
    Interval, error_ratio, paired_difference, summarise_clusters, unpaired_difference,
};
use serde::Deserialize;

#[derive(Deserialize)]
struct Golden {
    summaries: Vec<SummaryCase>,
    differences: Vec<DifferenceCase>,
    welch: Vec<WelchCase>,
    ratios: Vec<RatioCase>,
}

#[derive(Deserialize)]
struct SummaryCase {
    clusters: Vec<usize>,
    runs: Vec<f64>,
    mean: f64,
    interval: [f64; 2],
}

#[derive(Deserialize)]
struct DifferenceCase {
    clusters: Vec<usize>,
    x: Vec<f64>,
    y: Vec<f64>,
    mean: f64,
    interval: [f64; 2],
    smaller: [usize; 2],
}

/// The expected difference between a summary and the one two places after it.
#[derive(Deserialize)]
struct WelchCase {
    mean: f64,
    interval: [f64; 2],
}

#[derive(Deserialize)]
struct RatioCase {
    x: Vec<f64>,
    y: Vec<f64>,
    ratio: f64,
    interval: [f64; 2],
}

#[expect(clippy::unwrap_used, reason = "a broken golden file must fail the test")]
fn golden() -> Golden {
    serde_json::from_str(include_str!("../clusters.json")).unwrap()
}

#[track_caller]
fn assert_close(got: f64, expected: f64) {
    let tolerance = 1e-9 * expected.abs().max(1e-3);
    assert!((got - expected).abs() <= tolerance, "got {got}, expected {expected}");
}

#[track_caller]
fn assert_interval(got: Option<Interval>, [low, high]: [f64; 2]) {
    let got = got.expect("there are enough clusters");
    assert_close(got.low, low);
    assert_close(got.high, high);
}

#[test]
fn means_over_start_states_agree_with_numpy() {
    let cases = golden().summaries;
    assert_eq!(cases.len(), 12, "three models, two deployments, two sensors");
    for case in cases {
        let summary = summarise_clusters(&case.clusters, &case.runs).unwrap();
        assert_close(summary.mean, case.mean);
        assert_interval(summary.interval, case.interval);
    }
}

#[test]
fn paired_differences_agree_with_numpy() {
    let cases = golden().differences;
    assert_eq!(cases.len(), 4, "one pair of ensembles, two deployments, two sensors");
    for case in cases {
        let difference = paired_difference(&case.clusters, &case.x, &case.y).unwrap();
        assert_close(difference.mean, case.mean);
        assert_interval(difference.interval, case.interval);
        assert_eq!(difference.smaller, Some(case.smaller));
    }
}

#[test]
fn unpaired_differences_agree_with_scipy() {
    let Golden { summaries, welch, .. } = golden();
    assert_eq!(welch.len(), 10);
    for (case, (x, y)) in welch.iter().zip(summaries.iter().zip(&summaries[2..])) {
        let difference =
            unpaired_difference((&x.clusters, &x.runs), (&y.clusters, &y.runs)).unwrap();
        assert_close(difference.mean, case.mean);
        assert_interval(difference.interval, case.interval);
    }
}

#[test]
fn quotients_of_errors_agree_with_numpy() {
    let cases = golden().ratios;
    assert_eq!(cases.len(), 3, "every two of three models");
    for case in cases {
        let ratio = error_ratio(&case.x, &case.y).unwrap().unwrap();
        assert_close(ratio.ratio, case.ratio);
        assert_interval(ratio.interval, case.interval);
    }
}
