//! Several studies that are judged together.

use std::path::Path;

use serde_json::{Value, json};

use crate::harness::Place;

/// A study of a day and a half of a small plant, with two sensors and linear agents; it runs in seconds.
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
steps = 280
online_windows = 2
online_runs = 4
member_runs = 1
log_replay_runs = 2

[sweep.grid]
learning_rate = [1e-4, 1e-2, 1]

[evaluate]
resamples = 50
"#;

fn place() -> Place {
    let place = Place::new();
    std::fs::create_dir(place.path().join("plants")).expect("a folder");
    for (name, seed) in [("north", "1"), ("south", "2")] {
        place.write(&format!("plants/{name}.toml"), &STUDY.replace("SEED", seed));
    }
    place
}

/// Returns the method called `name` in the first score of a judgement.
fn method(json: &Value, name: &str) -> Value {
    let all = json["scores"][0]["methods"].as_array().expect("a list");
    all.iter().find(|method| method["method"] == name).expect("it is there").clone()
}

fn typical(json: &Value, name: &str) -> f64 {
    method(json, name)["typical"].as_f64().expect("finite")
}

#[test]
fn a_folder_of_studies_is_run_and_judged() {
    let place = place();
    let dry = place.calib(&["validity", "plants", "--dry-run"]).succeeds();
    let line = dry.lines().find(|line| line.trim_start().starts_with("north")).expect("listed");
    let words: Vec<&str> = line.split_whitespace().collect();
    assert_eq!(words, ["north", "adam", "linear", "0.8", "280", "16", "2", "to", "be", "run"]);
    assert!(dry.contains("2 of 2 plants are to be run"), "{dry}");
    let share = place.calib(&["validity", "plants", "--share", "1/2"]).succeeds();
    assert!(share.contains("share 1/2: 1 of 1 plant run"), "{share}");
    let dry = place.calib(&["validity", "plants", "--dry-run"]).succeeds();
    assert!(dry.contains("1 of 2 plants are to be run"), "{dry}");
    assert!(!place.path().join("plants/validity-results").exists());

    let judged = place.calib(&["validity", "plants", "--json", "-q"]);
    let json = judged.json(&[0]);
    let score = &json["scores"][0];
    assert_eq!((&score["part"], &score["pairs"]), (&"whole_run".into(), &4.into()));
    assert_eq!(score["plants"], json!(["north", "south"]));
    assert_eq!(score["models"], json!(["even", "near"]));
    assert_eq!(json["scores"].as_array().map(Vec::len), Some(1), "280 steps are 42 horizons");
    assert_eq!(json["plants"][1]["steps"], 280);
    for name in [
        "model:even",
        "model:near",
        "best_default",
        "log_replay",
        "latest_window",
        "default",
        "random",
        "hindsight",
        "another_window",
    ] {
        assert_eq!(method(&json, name)["pairs"], 4, "{name}");
    }
    // No method is better than the best fixed setting in hindsight, which
    // is at least as good as the study's default.
    assert!(typical(&json, "model:near") >= typical(&json, "hindsight"));
    assert!(typical(&json, "best_default") <= typical(&json, "default"));
    // Each pair has two models with known one-step errors.
    let accuracy = &score["accuracy"][0];
    assert_eq!((&accuracy["pairs"], &accuracy["models"]), (&4.into(), &8.into()));
    // The study and the judgement report the same.
    let own = place.calib(&["evaluate", "plants/north.toml", "--model", "near", "--json", "-q"]);
    let own = own.json(&[0, 1]);
    let regrets = [0_usize, 1].map(|sensor| {
        own["verdicts"][sensor]["truth"]["choice"]["regret"]["value"].as_f64().expect("finite")
    });
    let one = ["validity", "plants/north.toml", "--judge-only", "--output", "one", "--json", "-q"];
    let one = method(&place.calib(&one).json(&[0]), "model:near");
    let mean = one["mean"].as_f64().expect("finite");
    assert!((mean - f64::midpoint(regrets[0], regrets[1])).abs() < 1e-12, "{one}");

    let results = place.content("plants/validity-results");
    for file in ["validity.json", "pairs.parquet", "report.html", "figures/regret.svg"] {
        assert!(results.contains_key(Path::new(file)), "{file} is missing");
    }
    let page = String::from_utf8(results[Path::new("report.html")].clone()).expect("text");
    assert!(page.contains("Does calib choose well?") && page.contains("calib validity plants"));
    assert!(page.contains("Regret in every pair") && !page.contains("src=\"http"));

    // Run again, it trains nothing, and gives the same result on one thread.
    let again = place.calib(&["validity", "plants", "--threads", "1"]);
    let shown = again.succeeds();
    assert!(!again.stderr().contains("training runs made in"), "{}", again.stderr());
    assert!(place.content("plants/validity-results") == results);
    let in_tables: Vec<&str> = shown.lines().filter(|line| line.starts_with(' ')).collect();
    assert!(in_tables.len() > 40, "{shown}");
    let wide = in_tables.iter().find(|line| line.chars().count() > 100);
    assert_eq!(wide, None, "a terminal has 100 columns");
}

#[test]
fn what_cannot_be_judged_is_refused() {
    let place = place();
    let unfinished = place.calib(&["validity", "plants/north.toml", "--judge-only"]).fails(2);
    assert!(unfinished.contains("run `calib") && unfinished.contains("north.toml"), "{unfinished}");
    std::fs::create_dir(place.path().join("empty")).expect("a folder");
    place.calib(&["validity", "empty"]).fails_with(2, &["empty has no study (*.toml)"]);
    place.calib(&["validity", "plants", "plants/north.toml"]).fails_with(2, &["both called north"]);
    place.calib(&["validity", "plants", "--draw", "2"]).fails_with(2, &["--draw is for protocols"]);

    let blind = STUDY.replace("train_fraction = 0.7", "train_fraction = 1").replace("SEED", "1");
    place.write("plants/north.toml", &blind);
    let blind = place.calib(&["validity", "plants/north.toml"]).fails(2);
    assert!(blind.contains("north.toml holds no data out"), "{blind}");
    let own = "gamma = 0.8\ngammas = { TIT101 = 0.9 }";
    place.write("plants/north.toml", &STUDY.replace("gamma = 0.8", own).replace("SEED", "1"));
    let own = place.calib(&["validity", "plants/north.toml"]).fails(2);
    assert!(own.contains("north.toml gives sensors discount factors of their own"), "{own}");
    let other = STUDY.replace("[1e-4, 1e-2, 1]", "[1e-5, 1e-2]").replace("SEED", "1");
    place.write("plants/north.toml", &other);
    let other = place.calib(&["validity", "plants"]).fails(2);
    assert!(other.contains("the studies sweep different settings: north has"), "{other}");
    assert!(!place.path().join("plants/north-results").exists(), "nothing is run for nothing");
}

/// A protocol of two simulated plants, one that is too short for a score, and one whose data is missing.
const PROTOCOL: &str = r#"
[validity]
seed = 5
rollouts = false

[[validity.plants]]
study = "plant.toml"
repeat = 2
[validity.plants.draw]
"simulate.drift" = { from = 0.3, to = 3, scale = "log" }

[[validity.plants]]
study = "short.toml"
[validity.plants.draw]
"agent.gamma" = [0.99]

[[validity.plants]]
study = "elsewhere.toml"

[validity.task.draw]
"agent.optimiser" = ["adam", "sgd"]
"agent.gamma" = [0.2, 0.3]
"sweep.steps" = { from = 270, to = 300 }
"#;

fn protocol() -> Place {
    let place = Place::new();
    let study = STUDY.replace("seed = SEED\n", "").replace("SEED", "all");
    place.write("plant.toml", &study);
    place.write("short.toml", &study.replace("days = 1.5", "days = 0.2"));
    let elsewhere = study.replace("[simulate]\ndays = 1.5\nchannels = 12\nperiod_secs = 60\n", "");
    place.write("elsewhere.toml", &elsewhere.replace("data-all", "${CALIB_NOWHERE}/logs"));
    place.write("protocol.toml", PROTOCOL);
    place
}

const VALIDITY: [&str; 4] = ["validity", "protocol.toml", "--json", "-q"];

#[test]
fn a_protocol_draws_plants_and_goes_on_where_it_was() {
    let place = protocol();
    place.calib(&["validity", "protocol.toml", "--dry-run"]).succeeds_with(&[
        "plant-02",
        "left out: CALIB_NOWHERE is not set",
        "3 of 4 plants are to be run",
    ]);
    assert!(!place.path().join("validity-results").exists(), "nothing is written");

    let json = place.calib(&VALIDITY).json(&[0]);
    assert_eq!(json["protocol"], json!({"file": "protocol.toml", "seed": 5}));
    assert_eq!(json["scores"][0]["plants"], json!(["plant-01", "plant-02"]));
    let left_out = json["left_out"].as_array().expect("a list");
    assert_eq!(
        (&left_out[0]["plant"], &left_out[1]["plant"]),
        (&"short".into(), &"elsewhere".into())
    );
    let reason = left_out[0]["reason"].as_str().expect("text");
    assert!(reason.contains("is too short for gamma"), "{reason}");
    // At least 270 steps, three quarters of them, and gamma of at most 0.3
    // give 140 horizons: too few for the second score.
    assert_eq!(json["scores"].as_array().map(Vec::len), Some(1));
    let rules = json["scores"][0]["rules"].as_array().expect("a list").len();
    assert_eq!(rules, 16, "seven rules of two models, and what a race leaves");
    assert!(json["scores"][0]["accuracy"][0]["correlation"].is_null(), "there are no rollouts");

    // Each drawn study is an ordinary study.
    let study = "validity-results/draw-5/studies/plant-01.toml";
    let text = place.read(study);
    assert!(text.contains("with the seed 5") && text.contains("#     simulate.drift = "), "{text}");
    let again = place.calib(&["sweep", study]);
    again.succeeds();
    assert!(again.stdout().contains("up to date"), "{}", again.stdout());

    // Run again, it trains nothing. Lost results of a plant are made again, with the same bytes.
    let results = place.content("validity-results/draw-5");
    let again = place.calib(&VALIDITY[..2]);
    again.succeeds();
    assert!(!again.stderr().contains("training runs made in"), "{}", again.stderr());
    let sweep = "validity-results/draw-5/studies/plant-02-results/models/near/sweep";
    for lost in ["manifest.json", "runs.parquet", "units/PIT300/online/run-0001.json"] {
        std::fs::remove_file(place.path().join(sweep).join(lost)).expect("it was there");
    }
    std::fs::remove_dir_all(place.path().join(sweep.replace("near", "even")))
        .expect("it was there");
    let resumed = place.calib(&[&VALIDITY[..2], &["-v"]].concat());
    resumed.succeeds();
    assert!(resumed.stderr().contains("training runs made in"), "{}", resumed.stderr());
    assert!(place.content("validity-results/draw-5") == results);
}

#[test]
fn another_draw_confirms_and_leaves_the_first_as_it_is() {
    let place = protocol();
    place
        .calib(&["validity", "protocol.toml", "--judge-only"])
        .fails_with(2, &["no plant is left to judge (plant-01: it has not been run"]);
    let first = place.calib(&VALIDITY).json(&[0]);
    let results = place.content("validity-results/draw-5");
    let other = place.calib(&[&VALIDITY[..], &["--draw", "6"]].concat()).json(&[0]);
    assert_eq!(other["protocol"]["seed"], 6);
    assert_ne!(first["plants"], other["plants"], "other tasks");
    assert!(place.content("validity-results/draw-5") == results);
    // An interim judgement of the finished runs.
    let folder = place.path().join("validity-results/draw-6/studies/plant-02-results");
    std::fs::remove_dir_all(folder).expect("it was there");
    let so_far = [&VALIDITY[..], &["--draw", "6", "--judge-only"]].concat();
    let so_far = place.calib(&so_far).json(&[0]);
    assert_eq!(so_far["scores"][0]["plants"], json!(["plant-01"]));
    // A protocol with other draws draws its own plants.
    let drift = "{ from = 0.3, to = 3, scale = \"log\" }";
    place.write("protocol.toml", &PROTOCOL.replace(drift, "[0.7, 0.8]"));
    let redrawn = place.calib(&VALIDITY).json(&[0]);
    assert_eq!(redrawn["plants"], first["plants"], "the tasks stay");
    assert_ne!(redrawn["scores"][0]["methods"], first["scores"][0]["methods"]);
}

#[test]
fn a_protocol_is_told_from_studies() {
    let place = protocol();
    let run = place.calib(&["run", "protocol.toml"]).fails(2);
    assert!(run.contains("is a protocol of several studies; run it with `calib validity"), "{run}");
    place
        .calib(&["validity", "protocol.toml", "plant.toml"])
        .fails_with(2, &["is a protocol, which draws its own studies: name nothing beside it"]);
    // A folder with a protocol means the protocol. The studies beside it are those that it draws from.
    place.calib(&["validity", ".", "--dry-run"]).succeeds_with(&["plant-01"]);
    place.write("protocol.toml", &PROTOCOL.replace("agent.gamma", "agent.gama"));
    place.calib(&["validity", "protocol.toml"]).fails_with(2, &["did you mean `gamma`"]);
}
