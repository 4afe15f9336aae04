//! Reference values from NumPy and `SciPy`, made by `scripts/golden/validity.py`.

use std::collections::BTreeMap;

use calib_stats::Interval;
use calib_validity::{ModelPair, Pair, RuleChoice, Validity, judge};
use serde::{Deserialize, Deserializer};

#[derive(Deserialize)]
struct Golden {
    pairs: Vec<GoldenPair>,
    best_default: usize,
    summaries: BTreeMap<String, Summary>,
    comparisons: Vec<Comparison>,
}

#[derive(Deserialize)]
struct GoldenPair {
    plant: String,
    sensor: String,
    optimiser: String,
    #[serde(deserialize_with = "numbers")]
    regrets: Vec<f64>,
    default: usize,
    log_replay: usize,
    latest_window: usize,
    another_window: Option<f64>,
    models: BTreeMap<String, Model>,
}

#[derive(Deserialize)]
struct Model {
    chosen: usize,
    rules: BTreeMap<String, usize>,
}

#[derive(Deserialize)]
struct Summary {
    pairs: usize,
    diverged: usize,
    capped: usize,
    mean: f64,
    typical: f64,
    worst_tenth: f64,
    median: f64,
    good: f64,
    upper: Option<f64>,
    typical_interval: Option<[f64; 2]>,
}

#[derive(Deserialize)]
struct Comparison {
    method: String,
    against: String,
    pairs: usize,
    wins: usize,
    ties: usize,
    losses: usize,
    difference: f64,
    error_ratio: f64,
    plants: usize,
    std: Option<f64>,
    visible: Option<f64>,
    needed: [Option<usize>; 3],
    error_ratio_interval: Option<[f64; 2]>,
}

/// Reads numbers. JSON has no infinities, so they are written as text.
fn numbers<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<f64>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Number {
        Finite(f64),
        Infinite(String),
    }
    let all = Vec::<Number>::deserialize(deserializer)?;
    Ok(all
        .into_iter()
        .map(|number| match number {
            Number::Finite(value) => value,
            Number::Infinite(text) => text.parse().expect("inf"),
        })
        .collect())
}

fn golden() -> Golden {
    serde_json::from_str(include_str!("../golden.json")).expect("made by the script")
}

fn pair(golden: GoldenPair) -> Pair {
    Pair {
        plant: golden.plant,
        sensor: golden.sensor,
        optimiser: golden.optimiser,
        online: vec![1.0; golden.regrets.len()],
        regrets: Some(golden.regrets),
        default: Some(golden.default),
        log_replay: Some(golden.log_replay),
        latest_window: Some(golden.latest_window),
        another_window: golden.another_window,
        models: golden
            .models
            .into_iter()
            .map(|(name, model)| ModelPair {
                model: name,
                chosen: model.chosen,
                rules: model
                    .rules
                    .into_iter()
                    .map(|(rule, chosen)| RuleChoice { rule, chosen })
                    .collect(),
                ..ModelPair::default()
            })
            .collect(),
        ..Pair::default()
    }
}

fn judged(pairs: Vec<GoldenPair>) -> Validity {
    let values = ["a", "b", "c", "d", "e"].map(str::to_owned).to_vec();
    judge(values, pairs.into_iter().map(pair).collect(), &[]).expect("valid")
}

fn near(ours: Option<f64>, theirs: Option<f64>, what: &str) {
    let alike = match (ours, theirs) {
        (Some(ours), Some(theirs)) => (ours - theirs).abs() <= 1e-9 * theirs.abs().max(1.0),
        (ours, theirs) => ours.is_none() && theirs.is_none(),
    };
    assert!(alike, "{what}: {ours:?} instead of {theirs:?}");
}

/// Compares ends of intervals: quantiles of t agree to eight digits.
fn near_ends(ours: Option<Interval>, theirs: Option<[f64; 2]>, what: &str) {
    let ours = ours.map(|interval| [interval.low, interval.high]);
    let alike = match (ours, theirs) {
        (Some(ours), Some(theirs)) => {
            ours.iter().zip(&theirs).all(|(a, b)| (a - b).abs() <= 1e-7 * b.abs().max(1.0))
        }
        (ours, theirs) => ours.is_none() && theirs.is_none(),
    };
    assert!(alike, "{what}: {ours:?} instead of {theirs:?}");
}

#[test]
fn regrets_of_methods_are_those_of_numpy() {
    let golden = golden();
    let validity = judged(golden.pairs);
    assert_eq!(validity.best_default, golden.best_default);
    let all: Vec<_> = validity.methods.iter().chain(&validity.rules).collect();
    assert_eq!(all.len(), golden.summaries.len());
    for summary in all {
        let name = summary.method.name();
        let theirs = &golden.summaries[&name];
        let counts = (theirs.pairs, theirs.diverged, theirs.capped);
        assert_eq!((summary.pairs, summary.diverged, summary.capped), counts, "{name}");
        near(Some(summary.mean), Some(theirs.mean), &name);
        near(Some(summary.typical), Some(theirs.typical), &name);
        near(Some(summary.worst_tenth), Some(theirs.worst_tenth), &name);
        near(Some(summary.median), Some(theirs.median), &name);
        near(Some(summary.good), Some(theirs.good), &name);
        near(summary.upper, theirs.upper, &name);
        near_ends(summary.typical_interval, theirs.typical_interval, &name);
    }
}

#[test]
fn quotients_and_power_are_those_of_numpy_and_scipy() {
    let golden = golden();
    let validity = judged(golden.pairs);
    let mut compared = 0;
    for (comparison, power) in validity.comparisons.iter().zip(&validity.power) {
        let names = (comparison.method.name(), comparison.against.name());
        let theirs = golden.comparisons.iter();
        let mut theirs = theirs.filter(|it| (&it.method, &it.against) == (&names.0, &names.1));
        // Only calib compares the other models.
        let Some(theirs) = theirs.next() else {
            assert!(comparison.against.is_model(), "{names:?}");
            continue;
        };
        compared += 1;
        let what = format!("{names:?}");
        let counts = (theirs.pairs, theirs.wins, theirs.ties, theirs.losses);
        assert_eq!(
            (comparison.pairs, comparison.wins, comparison.ties, comparison.losses),
            counts,
            "{what}"
        );
        near(Some(comparison.difference), Some(theirs.difference), &what);
        near(Some(comparison.error_ratio), Some(theirs.error_ratio), &what);
        assert_eq!(power.plants, theirs.plants, "{what}");
        for (ours, theirs) in power.needed.into_iter().zip(theirs.needed) {
            // Quantiles of t agree to five digits where a hundred thousand plants are needed.
            let alike = ours.zip(theirs).is_some_and(|(a, b)| a.abs_diff(b) <= b / 20_000);
            assert!(alike, "{what}: {ours:?} instead of {theirs:?}");
        }
        near(power.std, theirs.std, &what);
        near(power.visible, theirs.visible, &what);
        near_ends(comparison.error_ratio_interval, theirs.error_ratio_interval, &what);
    }
    assert_eq!(compared, golden.comparisons.len());
}
