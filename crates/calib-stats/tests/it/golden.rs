//! Reference values from `SciPy` and NumPy, made by `scripts/golden/stats.py`.

use calib_stats::{
    Direction, average_ranks, competition_ranks, kendall_tau_b, quantile, spearman, summarise,
};
use serde::{Deserialize, Deserializer};

#[derive(Deserialize)]
struct Golden {
    intervals: Vec<IntervalCase>,
    correlations: Vec<CorrelationCase>,
    quantiles: Vec<QuantileCase>,
    ranks: RankCase,
}

#[derive(Deserialize)]
struct IntervalCase {
    #[serde(deserialize_with = "numbers")]
    runs: Vec<f64>,
    mean: f64,
    std: f64,
    low: f64,
    high: f64,
}

#[derive(Deserialize)]
struct CorrelationCase {
    #[serde(deserialize_with = "numbers")]
    x: Vec<f64>,
    #[serde(deserialize_with = "numbers")]
    y: Vec<f64>,
    spearman: f64,
    kendall_tau_b: f64,
}

#[derive(Deserialize)]
struct QuantileCase {
    #[serde(deserialize_with = "numbers")]
    values: Vec<f64>,
    p: f64,
    quantile: f64,
}

#[derive(Deserialize)]
struct RankCase {
    #[serde(deserialize_with = "numbers")]
    scores: Vec<f64>,
    competition: Vec<usize>,
    average: Vec<f64>,
}

/// Reads numbers. JSON has no infinities; the script writes them as `"inf"`.
fn numbers<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<f64>, D::Error> {
    let values = Vec::<serde_json::Value>::deserialize(deserializer)?;
    Ok(values.iter().map(|value| value.as_f64().unwrap_or(f64::INFINITY)).collect())
}

#[expect(clippy::unwrap_used, reason = "a broken golden file must fail the test")]
fn golden() -> Golden {
    serde_json::from_str(include_str!("../golden.json")).unwrap()
}

#[track_caller]
fn assert_close(got: f64, expected: f64) {
    let tolerance = 1e-9 * expected.abs().max(1e-3);
    assert!((got - expected).abs() <= tolerance, "got {got}, expected {expected}");
}

#[test]
fn intervals_agree_with_scipy() {
    for case in golden().intervals {
        let summary = summarise(&case.runs).unwrap();
        let interval = summary.interval.unwrap();
        assert_close(summary.mean, case.mean);
        assert_close(summary.std.unwrap(), case.std);
        assert_close(interval.low, case.low);
        assert_close(interval.high, case.high);
    }
}

#[test]
fn correlations_agree_with_scipy() {
    for case in golden().correlations {
        assert_close(spearman(&case.x, &case.y).unwrap().unwrap(), case.spearman);
        assert_close(kendall_tau_b(&case.x, &case.y).unwrap().unwrap(), case.kendall_tau_b);
    }
}

#[test]
fn quantiles_agree_with_numpy() {
    for case in golden().quantiles {
        assert_close(quantile(&case.values, case.p).unwrap(), case.quantile);
    }
}

#[test]
fn ranks_agree_with_scipy() {
    let case = golden().ranks;
    let ranks = competition_ranks(&case.scores, Direction::LowerIsBetter).unwrap();
    assert_eq!(ranks, case.competition);
    assert_eq!(average_ranks(&case.scores).unwrap(), case.average);
}
