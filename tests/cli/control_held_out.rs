//! Acting agents: held-out periods beside the training range.

use std::{fmt::Write as _, fs};

use crate::{
    control::corridor,
    harness::{Content, Place},
};

const RESULTS: &str = "study-results/control";
const DEPLOYMENTS: &str = "[deployments.beyond]\nstart = 2024-03-04\n[deployments.alike]\nstart = 2024-03-03\nend = 2024-03-04\n";
/// A part of the line that tells of training.
const TRAINING: &str = " ensemble members of ";

/// Returns the corridor with a training range, and further rows at positions that lie far from all others.
fn with_a_later_period() -> Place {
    let place = corridor();
    let mut log = place.read("log.csv");
    for row in 0..200 {
        let [hour, minute] = [row / 60, row % 60];
        let [position, action] = [50 + row % 5, row % 2];
        writeln!(log, "2024-03-04 {hour:02}:{minute:02}:00,{position},{action},-1,0")
            .expect("text");
    }
    place.write("log.csv", &log);
    place.edit_study("train_fraction = 1.0", "train = { end = 2024-03-03 }");
    place
}

/// The deployment `alike` is the end of the corridor's log. In `beyond` the positions lie far from all others.
#[test]
fn deployments_are_compared_with_the_training_range() {
    let place = with_a_later_period();
    let args = ["control", "study.toml", "--json"];
    let nothing = place.calib(&args).json(&[0, 1]);
    assert!(nothing.get("held_out").is_none(), "{nothing}");
    let study = place.read("study.toml");
    place.extend_study(DEPLOYMENTS);
    let status = place.calib(&["status", "study.toml"]).succeeds();
    assert!(status.contains("deployments.alike.end = nothing, now"), "{status}");
    // The agents are those of before. Only the periods are judged.
    let ran = place.calib(&args);
    let json = ran.json(&[1]);
    assert!(ran.stderr().contains("no agent is trained again"), "{}", ran.stderr());
    let [alike, beyond] = [0_usize, 1].map(|period| &json["held_out"][period]);
    assert_eq!((&alike["deployment"], &beyond["deployment"]), (&"alike".into(), &"beyond".into()));
    assert_eq!((&alike["uncovered"], &beyond["uncovered"]), (&0.0.into(), &1.0.into()));
    assert_eq!((&beyond["decisions"], &beyond["mean_reward"]), (&199.into(), &(-1.0).into()));
    let mean = beyond["behaviour"]["mean"].as_f64().expect("a number");
    assert!((mean + 10.0).abs() < 1e-9, "ten steps are an episode: {mean}");
    let mean = alike["behaviour"]["mean"].as_f64().expect("a number");
    assert!((-10.0..0.0).contains(&mean), "{mean}");
    let doubts = json["verdict"]["doubts"].as_array().expect("a list");
    let mut others = doubts.clone();
    others.retain(|doubt| doubt["reason"] != "held_out_uncovered");
    let of_period =
        serde_json::json!({ "reason": "held_out_uncovered", "deployment": "beyond", "share": 1.0 });
    assert!(doubts.contains(&of_period) && others.len() + 1 == doubts.len(), "{doubts:?}");
    assert_eq!(nothing["verdict"]["doubts"], serde_json::json!(others));
    let told = place.calib(&["control", "study.toml"]).ends(&[1]);
    for part in [
        "100 % of the decisions of the deployment beyond were made in states that",
        " training range ",
        " deployment alike ",
    ] {
        assert!(told.contains(part), "{part} is missing in {told}");
    }
    let report = place.read("study-results/control/report.html");
    assert!(report.contains("Held-out periods") && report.contains("deployment alike"));
    let again = place.content(RESULTS);
    assert!(place.calib(&["status", "study.toml"]).succeeds().contains("every step is done"));
    place.calib(&["control", "study.toml", "--force"]).ends(&[1]);
    assert!(place.content(RESULTS) == again, "the same bytes as if all was made at once");
    // A period may be without a name, and must be in the log.
    let held_out = "train = { end = 2024-03-03 }\nheld_out = { start = 2024-03-04 }";
    place.write("study.toml", &study.replace("train = { end = 2024-03-03 }", held_out));
    let json = place.calib(&args).json(&[1]);
    assert_eq!(json["held_out"].as_array().map(Vec::len), Some(1));
    assert!(json["held_out"][0].get("deployment").is_none(), "{}", json["held_out"]);
    assert_eq!(json["held_out"][0]["uncovered"], 1.0);
    let late = study.replace("train = {", "held_out = { start = 2025-01-01 }\ntrain = {");
    place.write("study.toml", &late);
    let told = place.calib(&args).fails(2);
    assert!(told.contains("held_out"), "{told}");
    place.write("study.toml", &study);
    let json = place.calib(&args).json(&[0, 1]);
    assert_eq!(json["verdict"]["doubts"], nothing["verdict"]["doubts"]);
}

/// The last fifth of the corridor's log has no rewards. It ends the command only if the study names it.
#[test]
fn a_last_fifth_without_a_decision_is_left_out() {
    let place = corridor();
    let mut log = String::new();
    for (number, line) in place.read("log.csv").lines().enumerate() {
        let mut cells: Vec<&str> = line.split(',').collect();
        // The period begins in row 2,400.
        if number > 2390 {
            cells[3] = "";
        }
        writeln!(log, "{}", cells.join(",")).expect("text");
    }
    place.write("log.csv", &log);
    place.edit_study("train_fraction = 1.0\n", "");
    let args = ["control", "study.toml", "--json"];
    let ran = place.calib(&args);
    let json = ran.json(&[0, 1]);
    assert!(json.get("held_out").is_none(), "{json}");
    let told = ran.stderr();
    assert!(told.contains("the period after data.train_fraction has no decision"), "{told}");
    let named = "[data]\ntrain = { end = 2024-03-02 }\nheld_out = { start = 2024-03-03 }\n";
    place.edit_study("[data]\n", named);
    let told = place.calib(&args).fails(2);
    assert!(told.contains("the held-out period has no decision to judge"), "{told}");
}

/// Writes these files of earlier results.
fn put(place: &Place, results: &Content, is_wanted: impl Fn(&str) -> bool) {
    for (name, bytes) in results.iter().filter(|(name, _)| name.to_str().is_some_and(&is_wanted)) {
        fs::write(place.path_of(RESULTS).join(name), bytes).expect("writable");
    }
}

/// Only the held-out periods change. A command that is killed in between has written the report and the verdict, or only
/// the report, and the manifest is the old one.
#[test]
fn a_kill_between_the_files_costs_no_run() {
    let place = with_a_later_period();
    let args = ["control", "study.toml"];
    assert!(place.calib(&args).stderr().contains(TRAINING), "the line that tells of training");
    let without = (place.read("study.toml"), place.content(RESULTS));
    place.extend_study(DEPLOYMENTS);
    place.calib(&args).ends(&[1]);
    let with = (place.read("study.toml"), place.content(RESULTS));
    for written in [&["report.html"][..], &["report.html", "verdict.json"]] {
        for (study, whole) in [&with, &without] {
            put(&place, &without.1, |_| true);
            put(&place, &with.1, |name| written.contains(&name));
            place.write("study.toml", study);
            let ran = place.calib(&args);
            ran.ends(&[0, 1]);
            assert!(!ran.stderr().contains(TRAINING), "{written:?}: {}", ran.stderr());
            assert!(place.content(RESULTS) == *whole, "{written:?}: the results of this study");
            let again = place.calib(&args);
            assert!(!again.stderr().contains("no agent is trained"), "{}", again.stderr());
        }
    }
}

#[test]
fn periods_that_nobody_judged_are_not_done() {
    let place = with_a_later_period();
    place.calib(&["control", "study.toml"]).ends(&[0, 1]);
    place.extend_study(DEPLOYMENTS);
    let before = place.content(RESULTS);
    place.calib(&["control", "study.toml", "--share", "0/2"]).succeeds();
    let status = place.calib(&["status", "study.toml"]).succeeds();
    assert!(status.contains("deployments.alike.end = nothing, now"), "{status}");
    let dry = place.calib(&["control", "study.toml", "--dry-run"]);
    let told = dry.stderr();
    assert!(told.contains("only the held-out periods have changed, and would be judged"), "{told}");
    assert!(place.content(RESULTS) == before, "neither writes");
    place.calib(&["control", "study.toml"]).ends(&[1]);
    // An unchanged log is not read again for the periods.
    for more in [&[][..], &["--dry-run"], &["--share", "0/2"]] {
        let ran = place.calib(&[&["control", "study.toml"][..], more].concat());
        let told = ran.stderr();
        assert!(told.contains("up to date") && !told.contains("reading the deployment"), "{told}");
    }
    let row = "2024-03-04 05:00:00,50,0,-1,0\n2024-03-04 05:01:00,50,0,-1,0\n";
    place.write("log.csv", &(place.read("log.csv") + row));
    let ran = place.calib(&["control", "study.toml", "--json"]);
    assert_eq!(ran.json(&[1])["held_out"][1]["decisions"], 200, "another log is read again");
    assert!(!ran.stderr().contains(TRAINING), "{}", ran.stderr());
}

/// In the period the row numbers begin anew, so that they look like a sensor, and a switch has a third word.
#[test]
fn periods_have_the_state_columns_of_the_training_range() {
    let place = with_a_later_period();
    let mut log = String::new();
    for (row, line) in place.read("log.csv").lines().enumerate() {
        let number = match row {
            0 => String::new(),
            1..=3000 => row.to_string(),
            _ => (1_000_000 + row).to_string(),
        };
        let valve = match row {
            0 => "valve",
            3100 => "FAULT",
            _ if row % 2 == 0 => "OPEN",
            _ => "CLOSED",
        };
        writeln!(log, "{number},{line},{valve}").expect("text");
    }
    place.write("log.csv", &log);
    place.extend_study("[deployments.fault]\nstart = 2024-03-04\n");
    let told = place.calib(&["control", "study.toml"]).fails(2);
    for part in [
        "valve is not the same state column when the deployment fault is read",
        "text, not numbers",
        "data.exclude = [\"valve\"]",
    ] {
        assert!(told.contains(part), "{part} is missing in {told}");
    }
    let without = ["control", "study.toml", "--json", "--set", "data.exclude=['valve']"];
    let json = place.calib(&without).json(&[1]);
    assert_eq!(json["held_out"][0]["decisions"], 199);
    assert_eq!(json["held_out"][0]["uncovered"], 1.0);
}
