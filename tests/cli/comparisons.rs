//! Intervals over start states, and pairwise comparisons of models.

use std::{collections::BTreeMap, fs};

use calib_core::Timestamp;
use calib_data::table::read_parquet;
use serde_json::Value;

use crate::harness::Place;

/// Quantiles of Student's t at 0.975 for 2 and 3 degrees of freedom.
const T: [f64; 2] = [4.302_652_729_749_464, 3.182_446_305_284_263];

/// Returns the symmetric2 distances of a sensor: per start state, one per ensemble member.
fn distances(place: &Place, directory: &str, sensor: &str) -> BTreeMap<Timestamp, Vec<f64>> {
    let table = read_parquet(&place.path().join(directory).join("dtw.parquet")).expect("readable");
    let sensors = table.column::<String>("sensor").expect("text");
    let patterns = table.column::<String>("step_pattern").expect("text");
    let starts = table.column::<Timestamp>("wanted_timestamp").expect("times");
    let values = table.column::<f64>("distance").expect("numbers");
    let mut of_starts: BTreeMap<Timestamp, Vec<f64>> = BTreeMap::new();
    for row in 0..table.rows() {
        if sensors[row] == sensor && patterns[row] == "symmetric2" {
            of_starts.entry(starts[row]).or_default().push(values[row]);
        }
    }
    of_starts
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[track_caller]
fn assert_is(written: &Value, means: &[f64]) {
    let n = means.len();
    let centre = mean(means);
    let variance = means.iter().map(|value| (value - centre).powi(2)).sum::<f64>() / (n - 1) as f64;
    let half = T[n - 3] * (variance / n as f64).sqrt();
    assert_near(&written["mean"], centre);
    assert_near(&written["interval"]["low"], centre - half);
    assert_near(&written["interval"]["high"], centre + half);
}

#[track_caller]
fn assert_near(value: &Value, expected: f64) {
    let got = value.as_f64().expect("a number");
    assert!((got - expected).abs() < 1e-9 * (1.0 + expected.abs()), "{got}, not {expected}");
}

#[test]
fn members_that_start_from_one_state_are_one_observation() {
    let place = Place::with_study();
    place.edit_study("rollouts = 2", "rollouts = 4\nstart = \"nearest\"");
    place.calib(&["build-model", "study.toml"]).succeeds();
    place
        .calib(&["rollout", "study.toml"])
        .succeeds_with(&["over 12 rollouts of", "steps from 4 start states"]);
    let manifest = place.read_json("study-results/rollout/manifest.json");
    let comparison = &manifest["comparison"];
    assert_eq!((&comparison["rollouts"], &comparison["start_states"]), (&12.into(), &4.into()));
    let written = &comparison["sensors"][0]["dtw"][0]["distance"];
    assert_eq!((&written["runs"], &written["clusters"]), (&12.into(), &4.into()));
    let starts = distances(&place, "study-results/rollout", "PIT300");
    assert!(starts.values().all(|members| members.len() == 3));
    assert_is(written, &starts.values().map(|members| mean(members)).collect::<Vec<_>>());

    let one = place.calib(&["rollout", "study.toml", "--set", "rollout.rollouts=1"]).succeeds();
    assert!(one.contains("from 1 start state, too few for an interval"), "{one}");
    let manifest = place.read_json("study-results/rollout/manifest.json");
    let of_sensor = &manifest["comparison"]["sensors"][0];
    assert_eq!(of_sensor["dtw"][0]["distance"]["interval"], Value::Null);
    assert_eq!(of_sensor["measures"][0]["value"]["interval"], Value::Null);

    let random = place.calib(&["rollout", "study.toml", "--set", "rollout.start=random"]);
    random.succeeds();
    let comparison = &place.read_json("study-results/rollout/manifest.json")["comparison"];
    assert_eq!(comparison["start_states"], comparison["rollouts"], "each member has its own");
}

#[test]
fn models_are_compared_start_by_start() {
    let place = Place::with_study();
    place.edit_study("rollouts = 2", "rollouts = 3\nstart = \"nearest\"");
    place.extend_study("\n[models.one.model]\nneighbors = 1\n[models.two]\n");
    place.run_steps(&["build-model", "rollout", "sweep"]);
    let compared = place.calib(&["evaluate", "study.toml"]);
    assert!(compared.stdout().contains("models two by two"), "{}", compared.stdout());
    assert!(compared.stdout().contains("one − two"), "{}", compared.stdout());

    let summary = place.read_json("study-results/evaluate/summary.json");
    let of_models = &summary["comparisons"]["rollouts"];
    assert_eq!(of_models.as_array().expect("a list").len(), 1);
    assert_eq!(of_models[0]["models"], serde_json::json!(["one", "two"]));
    let written = &of_models[0]["sensors"][1]["dtw"][0]["distance"];
    let [one, two] = ["one", "two"]
        .map(|model| distances(&place, &format!("study-results/models/{model}/rollout"), "TIT101"));
    assert_eq!(one.keys().collect::<Vec<_>>(), two.keys().collect::<Vec<_>>(), "the same starts");
    let differences: Vec<f64> =
        one.values().zip(two.values()).map(|(one, two)| mean(one) - mean(two)).collect();
    assert_is(written, &differences);
    let nearer = differences.iter().filter(|difference| **difference < 0.0).count();
    assert_eq!(written["smaller"], serde_json::json!([nearer, 3 - nearer]));
    let ratio = &summary["comparisons"]["one_step"][0]["all_columns"];
    assert_eq!(ratio["blocks"], 16);
    assert!(ratio["ratio"].as_f64().expect("a number") > 0.0);

    let report = place.read("study-results/report.html");
    for text in [
        "Models two by two",
        "One-step error, models two by two",
        "without a clear difference from it",
        "from 3 start states",
    ] {
        assert!(report.contains(text), "{text} is missing");
    }
    // Deleted distances are computed again.
    let path = place.path().join("study-results/models/one/rollout/dtw.parquet");
    let before = fs::read(&path).expect("readable");
    fs::remove_file(&path).expect("there");
    place.calib(&["evaluate", "study.toml"]).fails_with(2, &["dtw.parquet"]);
    place.calib(&["rollout", "study.toml"]).succeeds();
    assert!(fs::read(&path).expect("made again") == before);
}
