//! Dry runs of sweeps of acting agents.

use std::fs;

use serde_json::Value;

use crate::{control, harness::Place};

const STUDY: &str = "pole/study.toml";
const FOLDER: &str = "pole";

/// Returns the output of a dry run with these arguments.
fn told(place: &Place, command: &str, more: &[&str]) -> String {
    let ran = place.calib(&[&[command, STUDY, "--dry-run", "--threads", "2"][..], more].concat());
    assert_eq!(ran.succeeds(), "", "a plan is no result");
    ran.stderr()
}

/// Returns the plan of a dry run as JSON.
fn planned(place: &Place, more: &[&str]) -> Value {
    let args = [&["control", STUDY, "--dry-run", "--json", "-q"][..], more].concat();
    serde_json::from_str(&place.calib(&args).succeeds()).expect("JSON")
}

fn bytes(value: &Value) -> u64 {
    value.as_u64().expect("bytes")
}

fn secs(value: &Value) -> f64 {
    value.as_f64().expect("seconds")
}

#[test]
fn a_dry_run_says_what_a_sweep_takes() {
    let place = control::place();
    let before = place.content(FOLDER);
    for command in ["control", "run"] {
        let told = told(&place, command, &[]);
        for part in [
            "runs left to make: 18 of 18, on 2 threads",
            "memory: up to ",
            " beside calib itself (",
            " of neighbours, ",
            " of increments or networks, ",
            " a thread",
            "expecting about ",
            " on 2 threads (models ",
            ", constant actions and evaluations by the log alone ",
            " on disk beside the report",
            "dry run: nothing written to ",
        ] {
            assert!(told.contains(part), "{part} is missing in {told}");
        }
    }
    let alone = place.calib(&["control", STUDY, "--dry-run", "--threads", "1"]);
    let told = alone.stderr();
    assert!(told.contains("18 of 18, on 1 thread\n") && !told.contains("1 threads"), "{told}");
    let plan = planned(&place, &[]);
    assert_eq!((&plan["runs"], &plan["left"]), (&18.into(), &18.into()), "{plan}");
    let memory = &plan["memory"];
    assert!(
        bytes(&memory["total"]) > bytes(&memory["tables"]) + bytes(&memory["thread"]),
        "{plan}"
    );
    let expected = &plan["expected"];
    let parts = ["models_secs", "runs_secs", "other_secs"].map(|part| secs(&expected[part]));
    assert!(parts.iter().all(|&part| part > 0.0), "{plan}");
    assert!((secs(&expected["secs"]) - parts.iter().sum::<f64>()).abs() < 1e-6, "{plan}");
    assert!(place.content(FOLDER) == before, "nothing is written");
}

#[test]
fn a_sweep_that_the_disk_has_no_room_for_is_not_begun() {
    let place = control::place();
    let full = [("CALIB_FAULT", "free:10240")];
    for command in ["control", "run"] {
        let parts = ["the sweep may take ", " and 10.0 KiB are free where ", "lower control.runs"];
        place.calib_with(&[command, STUDY], &full).fails_with(2, &parts);
    }
    for folder in ["control", "control-model", "control-units"] {
        assert!(!place.path().join("pole/study-results").join(folder).exists(), "{folder}");
    }
}

#[test]
fn a_dry_run_counts_what_is_left() {
    let place = control::place();
    let new = planned(&place, &[]);
    // Two settings in three members of three kinds: 18 runs.
    place.calib(&["control", STUDY, "--share", "0/3"]).succeeds();
    let kept = place.content(FOLDER);
    let rest = planned(&place, &[]);
    assert_eq!((&rest["runs"], &rest["left"]), (&18.into(), &12.into()), "{rest}");
    assert!(bytes(&rest["disk"]) < bytes(&new["disk"]), "the model is there: {rest}");
    assert_eq!(planned(&place, &["--force"])["left"], 18);
    let done = told(&place, "control", &["--share", "0/3"]);
    assert!(done.contains("runs left to make of share 0/3: 0 of 6, on 2 threads"), "{done}");
    assert!(done.contains("(models 0.0 s, runs 0.0 s)"), "{done}");
    let other = told(&place, "control", &["--share", "1/3"]);
    assert!(other.contains("runs left to make of share 1/3: 6 of 6, on 2 threads"), "{other}");
    assert!(place.content(FOLDER) == kept, "nothing is written, and nothing goes");
    place.calib(&["control", STUDY]).ends(&[1]);
    // The verdict exists, so nothing is left to do, and a plan is not a verdict.
    let kept = place.content(FOLDER);
    let done = planned(&place, &[]);
    assert_eq!((&done["runs"], &done["left"], &done["disk"]), (&18.into(), &0.into(), &0.into()));
    assert_eq!(done["expected"]["secs"], 0.0, "{done}");
    for (command, share) in [("control", &[][..]), ("run", &[]), ("control", &["--share", "0/3"])] {
        let done = told(&place, command, share);
        assert!(done.contains("control is up to date"), "{done}");
        assert!(!done.contains("runs left to make"), "{done}");
    }
    assert!(place.content(FOLDER) == kept, "nothing is written");
    assert_eq!(planned(&place, &["--force"])["left"], 18);
}

#[test]
fn only_networks_without_a_valid_file_are_trained() {
    let place = control::place();
    let networks = "--set=control.models=['network']";
    place.calib(&["control", STUDY, networks]).ends(&[0, 1]);
    // Another grid needs other runs in the same networks.
    let other = [networks, "--set=control.grid={ step_size = [0.1] }"];
    let stored = planned(&place, &other);
    assert_eq!(secs(&stored["expected"]["models_secs"]), 0.0, "{stored}");
    assert_eq!(stored["memory"]["other_models"], 0, "{stored}");
    let network = place.path().join("pole/study-results/control-model/network-1.safetensors");
    fs::write(network, "damaged").expect("writable");
    let damaged = planned(&place, &other);
    assert!(secs(&damaged["expected"]["models_secs"]) > 0.0, "{damaged}");
    assert!(bytes(&damaged["disk"]) > bytes(&stored["disk"]), "{damaged}");
}

#[test]
fn shares_print_their_parts_of_the_plan_as_json() {
    let place = control::place();
    place.calib(&["control", STUDY, "--share", "1/4"]).succeeds();
    let whole = planned(&place, &[]);
    let parts: Vec<Value> =
        (0..4).map(|number| planned(&place, &["--share", &format!("{number}/4")])).collect();
    for part in ["runs", "left"] {
        let of_shares = parts.iter().map(|plan| plan[part].as_u64().expect("a number"));
        assert_eq!(Some(of_shares.sum::<u64>()), whole[part].as_u64(), "{part} of {parts:?}");
    }
    // The second of four shares has made its five of 18 runs.
    assert_eq!((&parts[1]["runs"], &parts[1]["left"]), (&5.into(), &0.into()), "{}", parts[1]);
    // Shares do not include constant actions and evaluations by the log alone.
    assert_eq!(parts[0]["expected"]["other_secs"], 0.0, "{}", parts[0]);
}

/// Options for neighbours in a small representation.
const LAPLACIAN: [&str; 2] = [
    "--set=control.model.distance='laplacian'",
    "--set=representation={ dimension = 4, hidden_units = 16, batch_size = 32, learning_rate = 3e-3, steps = 300 }",
];

/// Returns the plan of a sweep with distances in a representation.
fn in_representation(place: &Place, more: &[&str]) -> Value {
    planned(place, &[&LAPLACIAN[..], more].concat())
}

fn representation_secs(plan: &Value) -> f64 {
    secs(&plan["expected"]["representation_secs"])
}

#[test]
fn a_representation_counts_until_it_is_there() {
    let place = control::place();
    let plain = planned(&place, &[]);
    let new = in_representation(&place, &[]);
    assert_eq!((representation_secs(&plain), &plain["memory"]["representation"]), (0.0, &0.into()));
    assert!(representation_secs(&new) > 0.0, "{new}");
    // Ten thousand times as many updates.
    let longer = in_representation(&place, &["--set=representation.steps=3000000"]);
    assert!(representation_secs(&longer) > representation_secs(&new), "{longer} {new}");
    // At least 1,500 rows, with 4 columns twice and 4 dimensions.
    assert!(bytes(&new["memory"]["representation"]) > 1_500 * 12 * 4, "{new}");
    assert!(bytes(&new["disk"]) > bytes(&plain["disk"]), "{new}");
    let said = told(&place, "control", &LAPLACIAN);
    for part in [" of the representation, ", "(representation "] {
        assert!(said.contains(part), "{part} is missing in {said}");
    }
    let share = [&["control", STUDY, "--share", "0/20"][..], &LAPLACIAN].concat();
    place.calib(&share).succeeds();
    // With the same model, and with settings that need another model.
    let same: &[&str] = &[];
    for more in [same, &["--set=control.model.neighbors=2"]] {
        let made = in_representation(&place, more);
        assert_eq!(
            (representation_secs(&made), &made["memory"]["representation"]),
            (0.0, &0.into()),
            "{made}"
        );
    }
    let again = in_representation(&place, &["--force"]);
    assert!(representation_secs(&again) > 0.0, "{again}");
}

#[test]
fn many_runs_are_counted_without_a_list() {
    let place = control::place();
    // Two settings in three members of three kinds.
    let many = planned(&place, &["--set", "control.runs=100000"]);
    let all: Value = 1_800_000.into();
    assert_eq!((&many["runs"], &many["left"]), (&all, &all), "{many}");
    let share = ["--set", "control.runs=100000", "--share", "0/10000"];
    let few = told(&place, "control", &share);
    assert!(few.contains("runs left to make of share 0/10000: 180 of 180"), "{few}");
    let told = told(&place, "control", &["--set", "control.runs=100000"]);
    for part in ["runs left to make: 1,800,000 of ", "memory: up to ", "on disk"] {
        assert!(told.contains(part), "{part} is missing in {told}");
    }
}

#[test]
fn more_runs_than_anybody_makes_are_refused() {
    let place = control::place();
    let dry = ["control", STUDY, "--dry-run", "--set"];
    place
        .calib(&[&dry[..], &["control.runs=9000000000000000000"]].concat())
        .fails_with(2, &["expected from 1 to 100,000"]);
    // Twelve settings in three members: 3.6 million runs of each kind.
    let settings =
        "control.grid.step_size=[0.01,0.02,0.03,0.04,0.05,0.06,0.07,0.08,0.09,0.1,0.2,0.3]";
    let many = ["control.runs=100000", "--set", settings, "--share", "0/2"];
    place.calib(&[&dry[..], &many].concat()).fails_with(2, &["smaller shares"]);
}
