//! Discount factors of single sensors.

use calib_data::table::{Table, read_parquet};
use serde_json::Value;

use crate::harness::Place;

const BOTH: &str = "agent.gammas={ TIT101 = 0.8 }";

/// Runs the study with a key set, into its own folder.
fn run(place: &Place, output: &str, set: &str) {
    place.calib(&["run", "study.toml", "--output", output, "--set", set]).ends(&[0, 1]);
}

fn summary(place: &Place, output: &str) -> Value {
    place.read_json(&format!("{output}/evaluate/summary.json"))
}

/// Returns a column of the table of runs, for one sensor.
fn of_sensor(runs: &Table, sensor: &str, column: &str) -> Vec<f64> {
    let sensors = runs.column::<String>("sensor").expect("there");
    let values = runs.column::<f64>(column).expect("there");
    let rows = sensors.iter().zip(values).filter(|(name, _)| *name == sensor);
    rows.map(|(_, value)| *value).collect()
}

#[test]
fn a_sensor_is_predicted_as_in_a_study_of_its_own_gamma() {
    let place = Place::with_study();
    run(&place, "near", "agent.gamma=0.9");
    run(&place, "far", "agent.gamma=0.8");
    run(&place, "both", BOTH);
    let runs = |output: &str| {
        read_parquet(&place.path().join(output).join("sweep/runs.parquet")).expect("runs")
    };
    let verdict = |output: &str, sensor: &str| {
        let verdicts = summary(&place, output)["verdicts"].as_array().expect("a list").clone();
        verdicts.into_iter().find(|verdict| verdict["sensor"] == sensor).expect("judged")
    };
    let both = runs("both");
    for (sensor, output) in [("PIT300", "near"), ("TIT101", "far")] {
        let alone = runs(output);
        for column in ["gamma", "rmse", "nrmse", "error_scale"] {
            let of_both = of_sensor(&both, sensor, column);
            assert!(!of_both.is_empty());
            assert_eq!(of_both, of_sensor(&alone, sensor, column), "{column} of {sensor}");
        }
        assert_eq!(verdict("both", sensor), verdict(output, sensor));
    }
    assert_ne!(of_sensor(&runs("near"), "TIT101", "rmse"), of_sensor(&both, "TIT101", "rmse"));
    // The runs of the sensor without its own gamma are still valid.
    let units = |output: &str| place.content(&format!("{output}/sweep/units/PIT300"));
    assert!(units("both") == units("near"));
    let predicts = summary(&place, "both")["predicts"].as_str().expect("told").to_owned();
    let (near, far) = predicts.split_once(" Agents for TIT101 predict").expect("two sentences");
    assert!(
        near.starts_with("Agents for PIT300 predict") && near.contains("gamma = 0.9"),
        "{near}"
    );
    assert!(far.contains("gamma = 0.8"), "{far}");
    let report = place.read("both/report.html");
    assert!(report.contains("Agents for TIT101 predict"));
}

#[test]
fn a_gamma_of_a_sensor_that_is_not_predicted_is_refused() {
    let place = Place::with_study();
    let set = |value: &str| {
        place.calib(&["sweep", "study.toml", "--set", &format!("agent.gammas={value}")]).fails(2)
    };
    let unknown = set("{ TIT10 = 0.8 }");
    assert!(
        unknown.contains("agent.gammas names TIT10 (did you mean TIT101?), which sweep.sensors"),
        "{unknown}"
    );
    let outside = set("{ TIT101 = 1.0 }");
    assert!(outside.contains("`gammas`") && outside.contains("1 for TIT101"), "{outside}");
}

#[test]
fn a_race_orders_the_streams_of_each_gamma() {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    let race = ["--set", "sweep.race=halving", "--set", BOTH];
    place.calib(&[&["sweep", "study.toml"][..], &race].concat()).succeeds();
    place.calib(&[&["sweep", "study.toml"][..], &race].concat()).succeeds_with(&["up to date"]);
}

#[test]
fn a_sweep_is_judged_by_its_own_table_of_runs() {
    let place = Place::with_study();
    run(&place, "both", BOTH);
    let runs = ["--runs", "both/sweep/runs.parquet", "--output", "table/evaluate"];
    place.calib(&[&["evaluate", "study.toml"][..], &runs].concat()).ends(&[0, 1]);
    let told = |output: &str| {
        let summary = summary(&place, output);
        let values: Vec<Value> =
            (0..2_usize).map(|at| summary["choices"][at]["values"].clone()).collect();
        let horizons: Vec<Value> =
            (0..2_usize).map(|at| summary["verdicts"][at]["truth"]["horizons"].clone()).collect();
        (values, horizons)
    };
    let (values, horizons) = told("both");
    assert!(values.iter().all(Value::is_object) && horizons[0] != horizons[1], "{horizons:?}");
    assert_eq!(told("table"), (values, horizons));
}

#[test]
fn a_dry_run_counts_the_passes_of_each_gamma_before_the_model_is_there() {
    let place = Place::with_study();
    let passes = |command: &str| {
        let dry = place.calib(&[command, "study.toml", "--dry-run", "--set", BOTH]);
        assert_eq!(dry.code(), 0, "{}", dry.stderr());
        let told = dry.stderr();
        let (before, _) = told.split_once(" passes over the data").expect(&told);
        before.rsplit('(').next().and_then(|count| count.parse::<usize>().ok()).expect(&told)
    };
    let before = passes("run");
    place.calib(&["build-model", "study.toml"]).succeeds();
    assert_eq!(before, passes("sweep"));
    // Three members with two runs each, and three held-out runs, for each gamma.
    assert!(before >= 2 * 9, "{before}");
}
