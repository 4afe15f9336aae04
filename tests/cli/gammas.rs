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

fn runs(place: &Place, output: &str) -> Table {
    read_parquet(&place.path_of(output).join("sweep/runs.parquet")).expect("runs")
}

fn verdict(place: &Place, output: &str, sensor: &str) -> Value {
    let verdicts = summary(place, output)["verdicts"].as_array().expect("a list").clone();
    verdicts.into_iter().find(|verdict| verdict["sensor"] == sensor).expect("judged")
}

#[test]
fn a_sensor_is_predicted_as_in_a_study_of_its_own_gamma() {
    let place = Place::with_study();
    run(&place, "near", "agent.gamma=0.9");
    run(&place, "far", "agent.gamma=0.8");
    run(&place, "both", BOTH);
    let both = runs(&place, "both");
    for (sensor, output) in [("PIT300", "near"), ("TIT101", "far")] {
        let alone = runs(&place, output);
        for column in ["gamma", "rmse", "nrmse", "error_scale"] {
            let of_both = of_sensor(&both, sensor, column);
            assert!(!of_both.is_empty());
            assert_eq!(of_both, of_sensor(&alone, sensor, column), "{column} of {sensor}");
        }
        assert_eq!(verdict(&place, "both", sensor), verdict(&place, output, sensor));
    }
    assert_ne!(
        of_sensor(&runs(&place, "near"), "TIT101", "rmse"),
        of_sensor(&both, "TIT101", "rmse")
    );
    // The runs of the sensor without its own gamma are still valid.
    let units = ["both", "near"];
    let [both, near] = units.map(|name| place.content(&format!("{name}/sweep/units/PIT300")));
    assert!(both == near);
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
    let unknown = place.refusal("sweep", "agent.gammas={ TIT10 = 0.8 }");
    assert!(
        unknown.contains("agent.gammas names TIT10 (did you mean TIT101?), which sweep.sensors"),
        "{unknown}"
    );
    let outside = place.refusal("sweep", "agent.gammas={ TIT101 = 1.0 }");
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

/// Returns the chosen values and the horizons of both sensors.
fn values_and_horizons(summary: &Value) -> ([Value; 2], [Value; 2]) {
    let values = [0_usize, 1].map(|at| summary["choices"][at]["values"].clone());
    let horizons = [0_usize, 1].map(|at| summary["verdicts"][at]["truth"]["horizons"].clone());
    (values, horizons)
}

#[test]
fn a_sweep_is_judged_by_its_own_table_of_runs() {
    let place = Place::with_study();
    run(&place, "both", BOTH);
    let runs = ["--runs", "both/sweep/runs.parquet", "--output", "table/evaluate"];
    place.calib(&[&["evaluate", "study.toml"][..], &runs].concat()).ends(&[0, 1]);
    let (values, horizons) = values_and_horizons(&summary(&place, "both"));
    assert!(values.iter().all(Value::is_object) && horizons[0] != horizons[1], "{horizons:?}");
    assert_eq!(values_and_horizons(&summary(&place, "table")), (values, horizons));
}

/// Returns the passes over the data that a dry run counts.
fn passes(place: &Place, command: &str) -> usize {
    let dry = place.on_study(command, &["--dry-run", "--set", BOTH]);
    assert_eq!(dry.code(), 0, "{}", dry.stderr());
    let told = dry.stderr();
    let (before, _) = told.split_once(" passes over the data").expect(&told);
    before.rsplit('(').next().and_then(|count| count.parse().ok()).expect(&told)
}

#[test]
fn a_dry_run_counts_the_passes_of_each_gamma_before_the_model_is_there() {
    let place = Place::with_study();
    let before = passes(&place, "run");
    place.calib(&["build-model", "study.toml"]).succeeds();
    assert_eq!(before, passes(&place, "sweep"));
    // Three members with two runs each, and three held-out runs, for each gamma.
    assert!(before >= 2 * 9, "{before}");
}
