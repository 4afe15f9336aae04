//! Models without traps, from the study to the report.

use serde_json::Value;

use crate::harness::Place;

/// A study with four gaps per day. At two of them, members have traps unless these are removed.
const STUDY: &str =
    "[data]\npath = \"data\"\ntrain_fraction = 0.75\n\n[preprocess]\nfill_limit = 5\n";

fn place() -> Place {
    let place = Place::new();
    let sizes = ["--days", "2", "--channels", "12", "--period", "60", "--gaps-per-day", "4"];
    place.calib(&[&["simulate", "data"], &sizes[..]].concat()).succeeds();
    place.write("study.toml", STUDY);
    place
}

fn manifest(place: &Place) -> Value {
    place.read_json("study-results/model/manifest.json")
}

fn sum(manifest: &Value, value: impl Fn(&Value) -> &Value) -> u64 {
    let members = manifest["members"].as_array().expect("members");
    members.iter().map(|member| value(&member["recurrence"]).as_u64().expect("a number")).sum()
}

#[test]
fn traps_are_left_out_unless_the_study_says_otherwise() {
    let place = place();
    let as_found = ["build-model", "study.toml", "-v", "--set", "model.remove_traps=false"];
    let built = place.calib(&as_found);
    built.succeeds();
    let told = built.stderr();
    assert!(told.contains("trap") && told.contains("are trapped after about"), "{told}");
    assert!(built.stderr().contains("set model.remove_traps = true"), "{}", built.stderr());
    let found = manifest(&place);
    assert!(sum(&found, |recurrence| &recurrence["after"]["traps"]) > 0);
    assert_eq!(sum(&found, |recurrence| &recurrence["left_out"]), 0);

    let built = place.calib(&["build-model", "study.toml", "-v", "--verify", "50"]);
    built.succeeds();
    let told = built.stderr();
    assert!(told.contains("neighbours left out ("), "{told}");
    assert!(!told.contains("a few rows that they never leave"), "{}", built.stderr());
    let cured = manifest(&place);
    assert_eq!(
        sum(&cured, |recurrence| &recurrence["before"]["traps"]),
        sum(&found, |recurrence| &recurrence["after"]["traps"])
    );
    assert_eq!(sum(&cured, |recurrence| &recurrence["after"]["traps"]), 0);
    assert_eq!(sum(&cured, |recurrence| &recurrence["trapped"]), 0);
    let left_out = sum(&cured, |recurrence| &recurrence["left_out"]);
    assert!((1..100).contains(&left_out), "{left_out} left out");
    let stretches = &cured["members"][0]["recurrence"]["left_out_times"];
    assert!(stretches[0]["times"][0].as_str().is_some_and(|time| time.starts_with("2022-11-0")));
}

#[test]
fn what_is_drawn_decides_what_is_left_out() {
    let place = place();
    place.calib(&["build-model", "study.toml"]).succeeds();
    let uniform = ["rollout", "study.toml", "--set", "model.weights=uniform"];
    place.calib(&uniform).fails_with(2, &["build-model"]);
    // The inputs of the members are unchanged. Only the statistics of
    // their rollouts are computed again.
    let members = manifest(&place)["members"].clone();
    place.calib(&["build-model", "study.toml", "--set", "seed=7"]).succeeds();
    let again = manifest(&place)["members"].clone();
    assert_eq!(again[0]["recurrence"]["before"], members[0]["recurrence"]["before"]);
    assert_eq!(again[0]["recurrence"]["after"], members[0]["recurrence"]["after"]);
    assert_ne!(
        again[0]["recurrence"]["effective_rows"],
        members[0]["recurrence"]["effective_rows"]
    );
}
