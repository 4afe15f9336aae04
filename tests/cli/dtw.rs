//! `calib dtw`, and the comparison of rollouts with the record.

use std::{collections::BTreeMap, fs};

use calib_data::table::read_parquet;
use calib_dtw::{Dtw, StepPattern};
use serde_json::Value;

use crate::harness::{Place, Ran};

fn numbers(values: &Value) -> Vec<f64> {
    values
        .as_array()
        .expect("a list")
        .iter()
        .map(|value| value.as_f64().expect("a number"))
        .collect()
}

/// Returns distance and normalised distance per step pattern.
fn results(json: &str) -> BTreeMap<String, (f64, Option<f64>)> {
    let json: Value = serde_json::from_str(json).expect("JSON on stdout");
    let results = json["results"].as_array().expect("a list");
    results
        .iter()
        .map(|result| {
            let name = result["step_pattern"].as_str().expect("a name").to_owned();
            let distance = result["distance"].as_f64().expect("a number");
            (name, (distance, result["normalized_distance"].as_f64()))
        })
        .collect()
}

fn close(found: f64, expected: f64) -> bool {
    (found - expected).abs() <= 1e-9 * (1.0 + expected.abs())
}

/// Returns a place with `q.csv` (a time, two numbers) and `r.csv` (numbers without a header).
fn place() -> Place {
    let place = Place::new();
    place.write("q.csv", "time,flow,level\nmon,0,1\ntue,1,2\nwed,2,2\nthu,1,3\n");
    place.write("r.csv", "0\n0\n1\n2.5\n1\n");
    place
}

#[test]
fn distances_agree_with_the_reference_package() {
    let golden =
        concat!(env!("CARGO_MANIFEST_DIR"), "/crates/calib-dtw/tests/golden/distances.json");
    let text = fs::read_to_string(golden).expect("readable");
    let golden: Value = serde_json::from_str(&text).expect("JSON");
    let place = Place::new();
    let mut checked = 0;
    for case in golden["cases"].as_array().expect("a list") {
        for name in ["query", "reference"] {
            let values = numbers(&case[name]);
            let path = place.path().join(format!("{name}.npy"));
            calib_files::write_npy(&path, &values, values.len(), 1).expect("writable");
        }
        for (window, ends) in [("none", "closed"), ("slanted:8", "closed"), ("none", "openEnd")] {
            let expected: Vec<&Value> = case["results"]
                .as_array()
                .expect("a list")
                .iter()
                .filter(|result| result[1] == window && result[2] == ends && result[3].is_f64())
                .collect();
            let mut args = vec!["dtw", "query.npy", "reference.npy", "--json", "--window", window];
            args.extend((ends == "openEnd").then_some("--open-end"));
            for result in &expected {
                args.extend(["--step-pattern", result[0].as_str().expect("a name")]);
            }
            let found = results(&place.calib(&args).succeeds());
            for result in expected {
                let (raw, normalised) = found[result[0].as_str().expect("a name")];
                assert!(close(raw, result[3].as_f64().expect("a number")), "{result}: {raw}");
                assert_eq!(normalised.is_some(), result[4].is_f64(), "{result}");
                assert!(
                    normalised
                        .is_none_or(|found| close(found, result[4].as_f64().expect("a number")))
                );
                checked += 1;
            }
        }
    }
    assert!(checked > 100, "only {checked} values");
}

#[test]
fn the_default_is_the_table_of_the_paper() {
    let place = place();
    let table = place.calib(&["dtw", "q.csv:flow", "r.csv"]).succeeds();
    let names: Vec<&str> =
        table.lines().skip(1).filter_map(|line| line.split_whitespace().next()).collect();
    assert_eq!(names, ["symmetric2", "asymmetric", "symmetricP1", "rabinerJuang:6c"]);
    assert!(table.contains("1.000000    0.111111"), "{table}");
}

fn distance(place: &Place, query: &str, reference: &str) -> f64 {
    let json = place.calib(&["dtw", query, reference, "--json", "--step-pattern", "symmetric2"]);
    results(&json.succeeds())["symmetric2"].0
}

#[test]
fn columns_of_all_formats() {
    let place = place();
    place.simulate("data");
    // Two channels: (0, 1), (1, 2), (2, 2), (1, 3).
    let both = [0.0_f32, 1.0, 1.0, 2.0, 2.0, 2.0, 1.0, 3.0];
    calib_files::write_npy(&place.path().join("q.npy"), &both, 4, 2).expect("writable");
    assert_eq!(distance(&place, "q.csv:flow", "r.csv"), 1.0);
    assert_eq!(distance(&place, "q.csv:flow", "q.npy:0"), 0.0);
    assert_eq!(distance(&place, "q.csv:level", "q.npy:1"), 0.0);
    assert_eq!(distance(&place, "q.npy", "q.npy"), 0.0);
    let log = "data/2022-11-01.parquet:PIT300";
    assert_eq!(distance(&place, log, log), 0.0);
    let several = place.calib(&["dtw", "data/2022-11-01.parquet", log]).fails(2);
    assert!(several.contains("several numeric columns") && several.contains("PIT300"), "{several}");
}

#[test]
fn a_text_file_is_read_as_logs_are() {
    let place = place();
    let same = [
        ("semicolons.csv", "Tag;Durchfluss;Stand\nMo;0,0;1\nDi;1,0;2\nMi;2,0;2\nDo;1,0;3\n"),
        ("tabs.csv", "day\tDurchfluss\nmon\t0,0\ntue\t1,0\nwed\t2,0\nthu\t1,0\n"),
        ("quotes.csv", "Durchfluss\n\"0,0\"\n\"1,0\"\n\"2,0\"\n\"1,0\"\n"),
    ];
    for (name, text) in same {
        place.write(name, text);
        let column = format!("{name}:Durchfluss");
        let args = ["dtw", &column, "q.csv:flow", "--json", "--step-pattern", "symmetric2"];
        assert_eq!(results(&place.calib(&args).succeeds())["symmetric2"].0, 0.0, "{name}");
    }
    place.write("bare.csv", "0,5;1,5\n1,5;1\n");
    let args = ["dtw", "bare.csv:0", "bare.csv:1", "--json", "--step-pattern", "symmetric2"];
    assert_eq!(results(&place.calib(&args).succeeds())["symmetric2"].0, 1.5);
}

#[test]
fn the_path_is_written() {
    let place = place();
    let args = ["dtw", "q.csv:flow", "r.csv", "--step-pattern", "symmetric2", "--path", "path.csv"];
    place.calib(&args).succeeds();
    let path = place.read("path.csv");
    assert_eq!(path, "query,reference\n0,0\n0,1\n1,2\n2,3\n3,4\n");
    let message = place.calib(&["dtw", "q.csv:flow", "r.csv", "--path", "other.csv"]).fails(2);
    assert!(message.contains("exactly one --step-pattern, got 4"), "{message}");
}

/// Warps two series, and writes the warping path to a file.
pub(crate) fn align(
    place: &Place,
    [query, reference]: [&str; 2],
    path: &str,
    force: &[&str],
) -> Ran {
    let args = ["dtw", query, reference, "--step-pattern", "symmetric2", "--path", path];
    place.calib(&[&args[..], force].concat())
}

#[test]
fn a_path_replaces_only_the_file_that_is_named_with_force_and_never_what_is_read() {
    let place = place();
    place.write("mine.csv", "years of work");
    let read = fs::read(place.path().join("q.csv")).expect("there");
    let series = ["q.csv:flow", "r.csv"];
    align(&place, series, "mine.csv", &[])
        .fails_with(2, &["mine.csv is there already; --force replaces it"]);
    align(&place, series, "q.csv", &["--force"]).fails_with(2, &["q.csv is what is read"]);
    assert_eq!(fs::read(place.path().join("q.csv")).expect("there"), read);
    assert_eq!(fs::read(place.path().join("mine.csv")).expect("there"), b"years of work");
    align(&place, series, "mine.csv", &["--force"]).succeeds();
    assert_ne!(fs::read(place.path().join("mine.csv")).expect("there"), b"years of work");
}

fn asymmetric_distance(place: &Place, more: &[&str]) -> f64 {
    let args = ["dtw", "q.csv:flow", "r.csv", "--json", "--step-pattern", "asymmetric"];
    results(&place.calib(&[&args[..], more].concat()).succeeds())["asymmetric"].0
}

#[test]
fn ends_windows_and_local_distances() {
    let place = place();
    assert_eq!(asymmetric_distance(&place, &["--open-begin", "--open-end"]), 0.5);
    assert_eq!(asymmetric_distance(&place, &["--local-distance", "squared"]), 0.25);
    assert_eq!(
        asymmetric_distance(&place, &["--window", "sakoe-chiba:4"]),
        asymmetric_distance(&place, &[])
    );
}

fn message(place: &Place, args: &[&str]) -> String {
    place.calib(&[&["dtw"], args].concat()).fails(2)
}

#[test]
fn mistakes_are_explained() {
    let place = place();
    let several = message(&place, &["q.csv", "r.csv"]);
    assert!(several.contains("choose one as q.csv:COLUMN from: flow, level"), "{several}");
    let missing = message(&place, &["q.csv:flwo", "r.csv"]);
    assert!(
        missing.contains("no column `flwo`") && missing.contains("time, flow, level"),
        "{missing}"
    );
    let text = message(&place, &["q.csv:time", "r.csv"]);
    assert!(text.contains("column `time`") && text.contains("`mon` in line 2"), "{text}");
    let format = message(&place, &["q.txt", "r.csv"]);
    assert!(format.contains("expected FILE.npy, FILE.csv or FILE.parquet"), "{format}");
    let pattern = message(&place, &["q.csv:flow", "r.csv", "--step-pattern", "diagonal"]);
    assert!(pattern.contains("unknown step pattern `diagonal`"), "{pattern}");
    let begin = message(&place, &["q.csv:flow", "r.csv", "--open-begin"]);
    assert!(begin.contains("normalised by the query's length"), "{begin}");
    place.write("gap.csv", "flow,level\n1,2\n,3\n");
    let gap = message(&place, &["gap.csv:flow", "r.csv"]);
    assert!(gap.contains("sample 1") && gap.contains("fill or drop missing samples"), "{gap}");
    for word in ["bad", "n/a"] {
        place.write("word.csv", &format!("flow\n{word}\n1\n2\n"));
        let told = message(&place, &["word.csv", "r.csv"]);
        assert!(told.contains("column `flow`"), "{told}");
        assert!(told.contains(&format!("`{word}` in line 2")), "{word} is no unit: {told}");
    }
    place.write("comma.csv", "flow\n0,5\n1,5\n");
    let commas = message(&place, &["comma.csv:flow", "r.csv"]);
    assert!(commas.contains("comma.csv") && commas.contains("became two cells"), "{commas}");
    place.write("long.csv", &"1\n".repeat(9));
    let slopes = message(&place, &["q.csv:flow", "long.csv", "--step-pattern", "symmetricP1"]);
    assert!(slopes.contains("allows references of 3 to 7 samples"), "{slopes}");
    let window = message(&place, &["q.csv:flow", "long.csv", "--window", "sakoe-chiba:2"]);
    assert!(window.contains("widen it"), "{window}");
    // The help and the error about an unknown window use the same names.
    let unknown = message(&place, &["q.csv:flow", "long.csv", "--window", "wide"]);
    let help = place.calib(&["dtw", "--help"]).succeeds();
    for text in [unknown, help].map(|text| text.split_whitespace().collect::<Vec<_>>().join(" ")) {
        assert!(text.contains("none, sakoeChiba:RADIUS, slanted:RADIUS or itakura"), "{text}");
    }
}

#[test]
fn rollouts_are_compared_with_what_was_recorded() {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    let shown = place.calib(&["rollout", "study.toml"]).succeeds();
    assert!(shown.contains("over 6 rollouts of") && shown.contains("rabinerJuang:6c"), "{shown}");
    let directory = place.path().join("study-results/rollout");
    let [dtw, measures, trajectories] = ["dtw", "measures", "trajectories"]
        .map(|name| read_parquet(&directory.join(format!("{name}.parquet"))).expect("readable"));
    // 3 members, 2 rollouts, 2 sensors; 4 step patterns.
    assert_eq!((dtw.rows(), measures.rows()), (48, 12));
    assert!(measures.numbers("time_warp_edit").expect("numbers").iter().all(|&value| value > 0.0));

    // The distance of the first rollout, from its trajectory, is the same except for the unit.
    let steps = dtw.column::<u32>("steps").expect("a column")[0] as usize;
    let [visited, recorded, normalised] = ["PIT300", "PIT300.recorded", "PIT300.normalised"]
        .map(|name| trajectories.numbers(name).expect("numbers")[..=steps].to_vec());
    let other = visited.iter().position(|value| *value != visited[0]).expect("it moves");
    let scale = (visited[other] - visited[0]) / (normalised[other] - normalised[0]);
    let distance =
        Dtw::new(StepPattern::symmetric2()).distance(&visited, &recorded).expect("a path");
    let found = dtw.column::<f64>("distance").expect("a column")[0];
    assert!((found * scale / distance.raw - 1.0).abs() < 1e-3, "{found} {scale} {distance:?}");

    // Other settings need other results. Without steps there is nothing to compare.
    let fewer = ["rollout", "study.toml", "--set", "rollout.dtw_steps=50", "--json"];
    let json = place.calib(&fewer).json(&[0]);
    assert_eq!(json["comparison"]["most_steps"], 50);
    assert_eq!(json["comparison"]["sensors"][1]["dtw"][3]["distance"]["runs"], 6);
    place.calib(&["rollout", "study.toml", "--set", "rollout.dtw_steps=0"]).succeeds();
    assert!(
        !directory.join("dtw.parquet").exists() && !directory.join("measures.parquet").exists()
    );
}
