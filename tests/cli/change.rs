//! A simulated plant that changes: the changes are reported and kept beside the log, but not in it.

use crate::harness::{Place, Ran};

const CHANGING: [&str; 7] = [
    "--days=12",
    "--channels=12",
    "--period=600",
    "--change=1.5",
    "--feeds-per-year=50",
    "--settings-per-year=50",
    "--sensors-per-year=20",
];

fn changing(place: &Place, name: &str, more: &[&str]) -> Ran {
    place.calib(&[&["simulate", name][..], &CHANGING, more].concat())
}

#[test]
fn changes_are_told_and_lie_beside_the_log() {
    let place = Place::new();
    let told = changing(&place, "data", &[]).succeeds();
    let file = place.read_json("data/changes.json");
    let changes = file["changes"].as_array().expect("a list");
    assert!(changes.len() > 5 && file["format"] == 1, "{file}");
    let line = format!("{} changes from 2022-11-", changes.len());
    assert!(told.contains(&line) && told.contains("in data/changes.json"), "{told}");
    for change in changes {
        let at = change["at"].as_str().expect("a time");
        let words = change["told"].as_str();
        let at = at.replace('T', " ").replace('Z', "");
        assert!(told.contains(&format!("{at}  {}", words.expect("words"))), "{told}");
    }
    let kinds = ["feed", "settings", "sensor"];
    assert!(
        changes.iter().all(|change| kinds.iter().any(|kind| change["kind"] == *kind)),
        "{file}"
    );
    assert!(changes.iter().any(|change| change["gain"].is_number()), "sizes are numbers too");

    let json = changing(&place, "data", &["--json"]).json(&[0]);
    assert_eq!(json["changes"], file["changes"]);
    assert_eq!(json["written"], 0);
    let inspected = place.calib(&["inspect", "data", "--json"]).json(&[0]);
    assert_eq!(inspected["files"], 12, "what is no log is not read as one");
}

#[test]
fn a_plant_that_does_not_change_has_no_changes_beside_it() {
    let place = Place::new();
    let plain = ["simulate", "data", "--days", "2", "--channels", "12", "--period", "600"];
    let told = place.calib(&plain).succeeds();
    assert!(!told.contains("changes"), "{told}");
    assert!(!place.path().join("data/changes.json").exists());
    let options = &place.read_json("data/simulation.json")["options"];
    assert!(options.get("change").is_none(), "as it was written before there were any: {options}");

    let message = place.calib(&[&plain[..], &["--change", "1"]].concat()).fails(2);
    assert!(message.contains("holds another simulation"), "{message}");
    changing(&place, "data", &["--force"]).succeeds();
    assert!(place.path().join("data/changes.json").is_file());
    place.calib(&[&plain[..], &["--force"]].concat()).succeeds();
    assert!(!place.path().join("data/changes.json").exists(), "those of another plant are gone");
    let message = place.calib(&["simulate", "x", "--change", "3"]).fails(2);
    assert!(message.contains("`change` is 3, expected a number from 0 to 2"), "{message}");
}

#[test]
fn a_study_may_ask_for_change() {
    let place = Place::with_plant();
    place.edit_study(
        "[simulate]\n",
        "[simulate]\nchange = 2\nfeeds_per_year = 50\nsensors_per_year = 50\n",
    );
    let ran = place.calib(&["run", "study.toml", "-v"]);
    ran.succeeds();
    assert!(ran.stderr().contains(" changes from 2022-11-0"), "{}", ran.stderr());
    let report = place.read("study-results/report.html");
    assert!(report.contains("feeds_per_year = 50"), "the study says how its log was made");
}
