//! Several studies, judged together.

use crate::harness::Place;

/// A day and a half of a small plant, with two sensors and linear agents: seconds to run.
const STUDY: &str = r#"
seed = 3

[simulate]
days = 1.5
channels = 12
period_secs = 60
seed = SEED

[data]
path = "data-SEED"
train_fraction = 0.7

[model]
members = 2
neighbors = 2

[models.near]

[models.even.model]
weights = "uniform"

[rollout]
steps = 200
rollouts = 1

[agent]
value_function = "linear"
gamma = 0.8
batch_size = 16
learning_rate = 1e-2

[sweep]
sensors = ["PIT300", "TIT101"]
steps = 400
online_runs = 2
member_runs = 1
log_replay_runs = 1

[sweep.grid]
learning_rate = [1e-5, 1e-3, 1e-2]
"#;

fn place() -> Place {
    let place = Place::new();
    std::fs::create_dir(place.path().join("plants")).expect("a folder");
    for (name, seed) in [("north", "1"), ("south", "2")] {
        place.write(&format!("plants/{name}.toml"), &STUDY.replace("SEED", seed));
    }
    place
}

#[test]
fn a_folder_of_studies_is_run_and_judged() {
    let place = place();
    let dry = place.calib(&["validity", "plants", "--dry-run"]).succeeds();
    assert!(dry.contains("north, even is to be run") && dry.contains("south, near"), "{dry}");
    assert!(!place.path().join("plants/validity-results").exists());

    let judged = place.calib(&["validity", "plants", "--resamples", "200", "--json", "-q"]);
    let json: serde_json::Value = serde_json::from_str(&judged.succeeds()).expect("JSON");
    assert_eq!((&json["pairs"], &json["resamples"]), (&4.into(), &200.into()));
    assert_eq!(json["plants"], serde_json::json!(["north", "south"]));
    assert_eq!(json["models"], serde_json::json!(["even", "near"]));
    let method = |name: &str| -> serde_json::Value {
        let all = json["methods"].as_array().expect("a list");
        all.iter().find(|of| of["method"] == name).expect("it is there").clone()
    };
    for name in ["model:even", "model:near", "best_default", "log_replay", "default", "random"] {
        assert_eq!(method(name)["pairs"], 4, "{name}");
    }
    // Nobody beats the best of all values, and hindsight beats the study's default or equals it.
    let mean = |name: &str| method(name)["mean"].as_f64().expect("finite");
    assert!(mean("model:near") >= 0.0 && mean("best_default") <= mean("default"));
    // Two models in each pair, whose one-step errors are known.
    assert_eq!(
        (&json["accuracy"][0]["pairs"], &json["accuracy"][0]["models"]),
        (&4.into(), &8.into())
    );
    // What one study says is what the judgement says of it.
    let own = place.calib(&["evaluate", "plants/north.toml", "--model", "near", "--json", "-q"]);
    let own: serde_json::Value = serde_json::from_str(&own.stdout()).expect("JSON");
    let regret = own["verdicts"][0]["model_agreement"]["regret"].as_f64().expect("finite");
    let pairs = place.calib(&["validity", "plants/north.toml", "--judge-only", "--output", "one"]);
    let text = pairs.succeeds();
    let line = text
        .lines()
        .rfind(|line| line.trim_start().starts_with("north") && line.contains("PIT300"));
    let line = line.expect("the first pair").to_owned();
    let shown = line.split("  ").map(str::trim).filter(|cell| cell.ends_with('%')).nth(1);
    let shown: f64 = shown.expect("near").trim_end_matches(" %").parse().expect("a number");
    assert!((shown - 100.0 * regret).abs() <= 0.5, "{line}: {regret}");

    let results = place.content("plants/validity-results");
    for file in ["validity.json", "pairs.parquet", "report.html", "figures/regret.svg"] {
        assert!(results.contains_key(std::path::Path::new(file)), "{file} is missing");
    }
    let page = String::from_utf8(results[std::path::Path::new("report.html")].clone());
    let page = page.expect("text");
    assert!(page.contains("Does calib choose well?") && page.contains("calib validity plants"));
    assert!(page.contains("Regret in every pair") && !page.contains("src=\"http"));

    // Again, nothing is run, and on one thread it is the same.
    let again = place.calib(&["validity", "plants", "--resamples", "200", "--threads", "1"]);
    again.succeeds();
    assert!(!again.stderr().contains("units run in"), "{}", again.stderr());
    assert!(place.content("plants/validity-results") == results);
}

#[test]
fn what_cannot_be_judged_is_refused() {
    let place = place();
    let unfinished = place.calib(&["validity", "plants/north.toml", "--judge-only"]).fails(2);
    assert!(unfinished.contains("run `calib") && unfinished.contains("north.toml"), "{unfinished}");
    std::fs::create_dir(place.path().join("empty")).expect("a folder");
    let empty = place.calib(&["validity", "empty"]).fails(2);
    assert!(empty.contains("empty has no study (*.toml)"), "{empty}");
    let twice = place.calib(&["validity", "plants", "plants/north.toml"]).fails(2);
    assert!(twice.contains("both called north"), "{twice}");

    let blind = STUDY.replace("train_fraction = 0.7", "train_fraction = 1").replace("SEED", "1");
    place.write("plants/north.toml", &blind);
    let blind = place.calib(&["validity", "plants/north.toml"]).fails(2);
    assert!(blind.contains("north.toml holds no data out"), "{blind}");
    let other = STUDY.replace("[1e-5, 1e-3, 1e-2]", "[1e-5, 1e-2]").replace("SEED", "1");
    place.write("plants/north.toml", &other);
    let other = place.calib(&["validity", "plants"]).fails(2);
    assert!(other.contains("the studies sweep different values: north has"), "{other}");
    assert!(!place.path().join("plants/north-results").exists(), "nothing is run for nothing");
}
