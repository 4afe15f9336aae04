//! The `--json` output matches the schemas of the structs. Every `--json` run in these tests is checked
//! (`harness.rs`).

use serde_json::Value;

use crate::harness::{Place, schema};

#[test]
fn every_command_with_json_has_a_schema() {
    let place = Place::new();
    let mut with_json = Vec::new();
    for command in commands(&place.calib(&["--help"]).succeeds()) {
        if command == "help" {
            continue;
        }
        let help = place.calib(&[&command, "--help"]).succeeds();
        if command == "cluster" {
            for part in commands(&help).into_iter().filter(|part| part != "help") {
                let help = place.calib(&["cluster", &part, "--help"]).succeeds();
                if help.contains("--json") {
                    with_json.push(format!("cluster {part}"));
                }
            }
        } else if help.contains("--json") {
            with_json.push(command);
        }
    }
    with_json.sort();
    let known: Vec<String> = calib::json_schemas().into_keys().map(str::to_owned).collect();
    assert_eq!(with_json, known);
}

/// Returns the names of the commands in a help text.
fn commands(help: &str) -> Vec<String> {
    let list = help.split("Commands:").nth(1).expect("a list of commands");
    let names = list.lines().skip(1).take_while(|line| line.starts_with("  "));
    // Wrapped descriptions are indented further than names.
    let names = names.filter(|line| !line.starts_with("   "));
    names.filter_map(|line| line.split_whitespace().next().map(str::to_owned)).collect()
}

/// A word in place of a number, a missing key and an extra key, at the top level and deeper.
#[test]
fn what_is_not_in_the_schema_is_found() {
    let place = Place::with_study();
    let good = place.calib(&["inspect", "data", "--json"]).json(&[0]);
    let schema = schema::of("inspect");
    assert_eq!(schema::problem(&schema, &good), None);
    let mut other = good.clone();
    other["rows"] = Value::from("many");
    assert!(schema::problem(&schema, &other).expect("a problem").contains("rows"));
    let mut fewer = good.clone();
    fewer.as_object_mut().expect("an object").remove("gaps");
    assert!(schema::problem(&schema, &fewer).expect("a problem").contains("gaps"));
    let mut more = good.clone();
    more["rowz"] = Value::from(1);
    assert!(schema::problem(&schema, &more).expect("a problem").contains("rowz"));
    let mut deeper = good.clone();
    deeper["channels"][0]["meen"] = Value::from(1.0);
    let problem = schema::problem(&schema, &deeper).expect("a problem");
    assert!(problem.contains("$.channels[0]: meen"), "{problem}");
    let mut when = good;
    when["start"] = Value::from("2022-11-01 06:00:00");
    assert!(schema::problem(&schema, &when).is_some(), "no time as RFC 3339 has it");
}

/// The choice consists of the swept keys and their values.
#[test]
fn a_choice_is_a_structure() {
    let place = Place::with_study();
    let verdict = place.calib(&["run", "study.toml", "--json", "-q"]).json(&[0, 1]);
    let choices = verdict["choices"].as_array().expect("a list");
    assert_eq!(choices.len(), 2);
    for (choice, judged) in choices.iter().zip(verdict["verdicts"].as_array().expect("a list")) {
        assert_eq!(choice["sensor"], judged["sensor"]);
        let rate = choice["values"]["learning_rate"].as_f64().expect("a number");
        let index = judged["chosen"].as_u64().expect("a number") as usize;
        let label = verdict["candidates"][index].as_str().expect("words");
        let written: f64 = label.rsplit(' ').next().expect("a word").parse().expect("a number");
        assert_eq!(rate, written, "{label}");
    }
    for args in [&["run", "--dry-run"][..], &["rollout"], &["sweep"], &["sweep", "--dry-run"]] {
        place.calib(&[args, &["study.toml", "--json", "-q"]].concat()).ends(&[0, 1]);
    }
    place.calib(&["check", "study-results", "--json"]).succeeds();
    place.calib(&["explain", "agent.gamma", "--json"]).succeeds();
    place.calib(&["import", "data", "wide.parquet", "--json"]).succeeds();
    place.calib(&["init", "data", "other.toml", "--within", "20s", "--json"]).succeeds();
}
