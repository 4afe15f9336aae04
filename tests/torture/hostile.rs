//! Malformed studies, profiles, manifests, units and imports: text with changed bytes, and JSON with other values
//! under a valid fingerprint. Nothing panics, aborts, hangs or takes four gibibytes.
//!
//!     CALIB_CASES=10000 CALIB_SEED=7 cargo test --release --test torture hostile -- --nocapture

use std::{
    fs,
    path::{Path, PathBuf},
};

use calib_files::{read_json, write_npy, write_sealed_json};
use serde_json::{Value, json};

use crate::{
    campaign::{Draws, everything, neighbours, number},
    faults::copied,
    harness::Place,
    limits::{Ended, TriedCase, run, run_cases},
};

/// Cases that run with the other tests.
const SLICE: u64 = 40;

/// Words that parsers look for.
const WORDS: [&str; 24] = [
    "[",
    "]",
    "[[",
    "=",
    "\"",
    "'''",
    "{",
    "}",
    ",",
    "\n",
    "-",
    "1e999",
    "nan",
    "0x",
    "9223372036854775808",
    "9999-12-31",
    "[models.near]",
    "[profiles.tiny]\nbase = \"tiny\"",
    "base = ",
    "[deployments.d]",
    "start",
    "\u{0}",
    "é",
    "seed = 1",
];

/// Changes some words and letters of a text.
fn edited(text: &str, draws: &mut Draws) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    for _ in 0..=draws.below(4) {
        let place = draws.below(bytes.len());
        match draws.below(5) {
            0 => bytes[place] ^= 1 << draws.below(8),
            1 => bytes.truncate(place),
            2 => drop(bytes.drain(place..(place + 1 + draws.below(30)).min(bytes.len()))),
            3 => {
                let from = draws.below(bytes.len());
                let part = bytes[from..(from + draws.below(60)).min(bytes.len())].to_vec();
                drop(bytes.splice(place..place, part));
            }
            _ => drop(bytes.splice(place..place, draws.of(&WORDS).bytes())),
        }
        if bytes.is_empty() {
            break;
        }
    }
    bytes
}

/// Returns an unexpected value.
fn odd(draws: &mut Draws) -> Value {
    let deep = (0..60).fold(json!(1), |inside, _| json!([inside]));
    let all = [
        json!(null),
        json!(true),
        json!(-1),
        json!(0),
        json!(1),
        json!(2),
        json!(0.5),
        json!(-0.0),
        json!(1e308),
        json!(u64::MAX),
        json!(i64::MIN),
        json!(4_294_967_296_u64),
        json!(""),
        json!("../../up"),
        json!("\u{1b}[2J"),
        json!([]),
        json!({}),
        json!([0]),
        json!("9999-12-31"),
        deep,
    ];
    draws.of(&all).clone()
}

/// Changes a value somewhere inside a JSON value.
fn change(value: &mut Value, draws: &mut Draws) {
    let go_on = draws.below(5) > 0;
    match value {
        Value::Object(entries) if go_on && !entries.is_empty() => {
            let key = entries.keys().nth(draws.below(entries.len())).expect("there").clone();
            match draws.below(8) {
                0 => drop(entries.remove(&key)),
                _ => change(&mut entries[&key], draws),
            }
        }
        Value::Array(items) if go_on && !items.is_empty() => {
            let place = draws.below(items.len());
            match draws.below(8) {
                0 => drop(items.remove(place)),
                1 => items.push(items[place].clone()),
                _ => change(&mut items[place], draws),
            }
        }
        other => *other = odd(draws),
    }
}

/// Returns the files of a place whose names `wanted` accepts.
fn files(place: &Place, wanted: impl Fn(&str) -> bool) -> Vec<PathBuf> {
    let content = place.content("study-results");
    content.into_keys().filter(|path| path.to_str().is_some_and(&wanted)).collect()
}

/// Kinds of changed files.
const TARGETS: [&str; 5] = ["study", "profile", "manifest", "unit", "import"];

struct Bases {
    /// Place after `run`.
    made: Place,
    /// Sealed JSON files of each kind.
    manifests: Vec<PathBuf>,
    units: Vec<PathBuf>,
    /// Place after `simulate`, with a profile and an import.
    plain: Place,
}

impl Bases {
    fn new() -> Self {
        let made = everything();
        made.calib(&["run", "study.toml", "-q"]).ends(&[0, 1]);
        let manifests = files(&made, |name| {
            is_json(name) && !name.contains("run-") && !name.contains("evaluate")
        });
        let units = files(&made, |name| is_json(name) && name.contains("run-"));
        let plain = neighbours();
        plain.calib(&["simulate", "study.toml", "-q"]).succeeds();
        Self { made, manifests, units, plain }
    }

    fn case(&self, target: &str, draws: &mut Draws) -> (String, Ended) {
        match target {
            "study" | "profile" => {
                let place = copied(&self.plain);
                let profile = "\n[profiles.small]\nbase = \"tiny\"\nsweep = { steps = 40 }\n\n[profiles.tiny]\nseed = 4\n\
                               [profiles.tiny.agent]\ngamma = 0.5\n";
                let text = if target == "profile" {
                    [place.read("study.toml").as_bytes(), &edited(profile, draws)].concat()
                } else {
                    edited(&(place.read("study.toml") + profile), draws)
                };
                fs::write(place.path().join("study.toml"), text).expect("writable");
                let args = ["run", "study.toml", "--profile", "small", "--dry-run"];
                let args = if target == "profile" {
                    &args[..]
                } else {
                    &["run", "study.toml", "--dry-run"]
                };
                (
                    args.join(" "),
                    run(&place, args, &["study", "profile", "data", "sensor", "model", "sweep."]),
                )
            }
            "import" => import(&self.plain, draws),
            _ => {
                let place = copied(&self.made);
                let all = if target == "unit" { &self.units } else { &self.manifests };
                let name = draws.of(all);
                let path = place.path().join("study-results").join(name);
                let mut value: Value = read_json(&path).expect("JSON");
                value.as_object_mut().expect("an object").remove("fingerprint");
                change(&mut value, draws);
                if write_sealed_json(&path, &value).is_err() {
                    return (String::new(), Ended::Done);
                }
                let commands: [&[&str]; 5] = [
                    &["run", "study.toml"],
                    &["evaluate", "study.toml"],
                    &["sweep", "study.toml", "--dry-run"],
                    &["rollout", "study.toml"],
                    &["check", "study-results", "--read-data"],
                ];
                let args = *draws.of(&commands);
                let names = ["study", "calib", "sensor", "model", "data", "representation"];
                (
                    format!("{} after {}: {value}", args.join(" "), name.display()),
                    run(&place, args, &names),
                )
            }
        }
    }
}

fn is_json(name: &str) -> bool {
    Path::new(name).extension().is_some_and(|kind| kind == "json")
}

/// Imports ψ from a file with changed bytes.
fn import(base: &Place, draws: &mut Draws) -> (String, Ended) {
    let place = copied(base);
    let path = place.path().join("psi.npy");
    let rows = 216;
    let columns = 1 + draws.below(3);
    let values: Vec<f32> = (0..rows * columns).map(|place| (place as f32).sin()).collect();
    write_npy(&path, &values, rows, columns).expect("written");
    let mut bytes = fs::read(&path).expect("readable");
    for _ in 0..draws.below(4) {
        let end = if draws.below(2) == 0 { 128 } else { bytes.len() };
        let place = draws.below(end);
        bytes[place] = draws.next() as u8;
    }
    fs::write(&path, bytes).expect("writable");
    let import = ["--set=representation.kind=import", "--set=representation.path=psi.npy"];
    let args = ["represent", "study.toml", import[0], import[1]];
    (args.join(" "), run(&place, &args, &["psi.npy", "representation"]))
}

#[test]
fn hostile() {
    let bases = Bases::new();
    run_cases("hostile", number("CALIB_CASES", SLICE), 3 << 30, |case, draws| {
        let target = TARGETS[case % TARGETS.len()];
        let (told, ended) = bases.case(target, draws);
        let told = told.chars().take(1500).collect();
        TriedCase { kind: format!("hostile: {target}"), told, ended }
    });
}
