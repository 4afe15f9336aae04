//! Several deployments of one study: each has its own held-out runs and
//! start states, and shared runs are made once.

use std::fs;

use insta::assert_snapshot;

use crate::harness::{Place, assert_same};

const NEAR: &str = "{ start = 2022-11-03, end = 2022-11-03T12:00:00 }";
const DEPLOYMENTS: &str = "
[deployments.near]
start = 2022-11-03
end = 2022-11-03T12:00:00

[deployments.far]
start = 2022-11-03T12:00:00
end = 2022-11-04
";

/// Returns a study of three days: two of training, and two deployments of half a day.
fn place(start: &str, more: &str) -> Place {
    let place = Place::with_study();
    place.edit_study("train_fraction = 0.7", "train = { end = 2022-11-03 }");
    // Runs are shorter than both windows, so that they have the same length in both.
    place.edit_study("steps = 800", "steps = 500");
    place.edit_study("rollouts = 2", &format!("rollouts = 3\nstart = \"{start}\""));
    place.extend_study(&format!("{DEPLOYMENTS}{more}"));
    place
}

/// Runs `calib` and returns its output.
fn run(place: &Place, args: &[&str]) -> String {
    place.calib(args).succeeds()
}

#[test]
fn a_deployment_is_a_study_in_which_it_is_held_out() {
    let place = place("nearest", "");
    run(&place, &["build-model", "study.toml"]);
    let rolled = run(&place, &["rollout", "study.toml"]);
    assert!(rolled.contains("against the deployment"), "{rolled}");
    assert!(rolled.contains("start states lie in the block that it leaves out"), "{rolled}");
    let seen = run(&place, &["inspect", "study.toml"]);
    assert!(seen.contains("deployment near: 2022-11-03 00:00:00 to"), "{seen}");
    assert!(seen.contains("deployment far: 2022-11-03 12:00:00 to"), "{seen}");
    let dry = place.calib(&["sweep", "study.toml", "--dry-run"]);
    let told = dry.stderr();
    assert!(told.contains("; all "), "{told}");
    assert!(told.contains("an earlier model or deployment makes 4 runs of each setting"), "{told}");
    assert!(told.contains("deployment near") && told.contains("deployment far"), "{told}");
    assert!(!place.path().join("study-results/deployments/near/sweep").exists());
    let swept = run(&place, &["sweep", "study.toml"]);
    // Two sensors in three members with two runs, three held-out runs and two of log replay; the second deployment
    // already has the last.
    assert!(
        swept.contains("66 training runs made") && swept.contains("54 training runs made"),
        "{swept}"
    );
    let verdict = run(&place, &["evaluate", "study.toml"]);
    assert!(verdict.contains("what to deploy") && verdict.contains("for all"), "{verdict}");
    let again = run(&place, &["sweep", "study.toml"]);
    assert_eq!(again.matches("up to date").count(), 2, "{again}");
    assert_eq!(run(&place, &["rollout", "study.toml"]).matches("up to date").count(), 2);

    // Deployments are in order of time, each with its window and its choice.
    let summary = place.read_json("study-results/evaluate/summary.json");
    assert_eq!(summary["deployments"][0]["deployment"], "near");
    assert_eq!(summary["deployments"][0]["window"], "2022-11-03 .. 2022-11-03T12:00:00");
    assert_eq!(
        summary["deployments"][1]["models"]["Euclidean kNN"]["verdicts"][0]["sensor"],
        "PIT300"
    );
    let deploy = &summary["what_to_deploy"][0];
    assert_eq!(deploy["choices"].as_array().expect("a list").len(), 2);
    for choice in deploy["choices"].as_array().into_iter().flatten() {
        assert_told(&choice["chosen"], &choice["values"]);
    }
    assert_told(&deploy["for_all"], &deploy["for_all_values"]);
    assert_no_agent_for_all(deploy);
    let report = place.read("study-results/report.html");
    for text in [
        "What to deploy",
        "PIT300 (near)",
        "PIT300 (far)",
        "Dynamic time warping (all deployments)",
        "far: held-out range",
        "Start states",
        "PIT300: recorded in each period",
        "near: 2022-11-03 00:00 to ",
        "far: 2022-11-03 12:00 to ",
    ] {
        assert!(report.contains(text), "{text} is missing");
    }
    assert!(
        place.path().join("study-results/evaluate/figures/sensitivity-PIT300-near.svg").is_file()
    );
    let own = place.read("study-results/deployments/near/report.html");
    assert!(own.contains(" of near, 2022-11-03 00:00:00 to"));
    let manifest = place.read_json("study-results/deployments/near/rollout/manifest.json");
    let starts = &manifest["members"][0]["starts"];
    assert_eq!(starts["starts"], 3);
    let [largest, mean] = ["largest_distance", "mean_distance"]
        .map(|name| starts[name].as_f64().expect("there is one"));
    assert!(largest >= mean, "{starts}");

    // The same study with only that window held out gives the same bytes.
    let text = place.read("study.toml");
    let held_out = format!("train = {{ end = 2022-11-03 }}\nheld_out = {NEAR}");
    let alone = text.replace(DEPLOYMENTS, "").replace("train = { end = 2022-11-03 }", &held_out);
    place.write("study.toml", &alone);
    for command in ["build-model", "rollout", "sweep", "evaluate"] {
        run(&place, &[command, "study.toml", "--output", "alone", "--threads", "1"]);
    }
    for part in ["rollout", "sweep"] {
        let one = place.content(&format!("study-results/deployments/near/{part}"));
        assert_same(&one, &place.content(&format!("alone/{part}")));
    }
}

/// Asserts that an agent is recommended for all deployments only if one of them is to get an agent.
fn assert_no_agent_for_all(deploy: &serde_json::Value) {
    let mut choices = deploy["choices"].as_array().expect("a list").iter();
    let gets_one = choices.any(|choice| is_agent(&choice["recommendation"]));
    assert_eq!(is_agent(&deploy["for_all_recommendation"]), gets_one, "{deploy}");
}

fn is_agent(advice: &serde_json::Value) -> bool {
    ["deploy", "keep_default", "not_checked"].iter().any(|agent| advice == agent)
}

/// Asserts that the words for a setting end with its learning rate, its only value.
fn assert_told(words: &serde_json::Value, values: &serde_json::Value) {
    let written = words.as_str().and_then(|words| words.split_whitespace().last());
    assert_eq!(values["learning_rate"].as_f64(), written.and_then(|word| word.parse().ok()));
    assert_eq!(values.as_object().map(serde_json::Map::len), Some(1), "{values}");
}

#[test]
fn what_does_not_depend_on_the_deployment_is_run_once() {
    let models = "[models.year]\n[models.narrow.model]\nneighbors = 2\n";
    let pretrain = "[pretrain]\nepochs = 2\nlearning_rate = 1e-3\nfraction = 0.4\n";
    let place = place("random", &format!("{models}{pretrain}"));
    run(&place, &["pretrain", "study.toml"]);
    run(&place, &["build-model", "study.toml"]);
    // There is one rollout per model, whatever the deployments.
    assert_eq!(run(&place, &["rollout", "study.toml"]).matches("wrote").count(), 2);
    assert!(!place.path().join("study-results/models/year/deployments").exists());
    let first = run(&place, &["sweep", "study.toml", "--deployment", "near"]);
    assert!(
        first.contains("66 training runs made") && first.contains("36 training runs made"),
        "{first}"
    );
    // Runs in members and log replay are the same for both deployments. Held-out runs are the same for both models.
    let second = run(&place, &["sweep", "study.toml"]);
    assert!(second.contains("18 training runs made"), "{second}");
    assert_eq!(second.matches("up to date").count(), 3, "{second}");
    let verdict = run(&place, &["evaluate", "study.toml", "-q"]);
    // All models choose the same setting everywhere. But such short runs learn nothing beyond a line.
    assert!(verdict.contains("what to deploy") && verdict.contains("no agent: "), "{verdict}");
    let summary = place.read_json("study-results/evaluate/summary.json");
    let deployed = summary["what_to_deploy"].as_array().expect("a list");
    assert_eq!(deployed.len(), 4, "two sensors and two models");
    deployed.iter().for_each(assert_no_agent_for_all);
    let report = place.read("study-results/report.html");
    assert!(report.contains("year, worst rank") && report.contains("narrow, worst rank"));
    assert!(report.contains("calib pretrain study.toml"));
    // One deployment, both models.
    let one = run(&place, &["evaluate", "study.toml", "--deployment", "far", "-q"]);
    assert!(one.contains("study-results/deployments/far/report.html"), "{one}");
    // One model, both deployments.
    run(&place, &["evaluate", "study.toml", "--model", "year", "-q"]);
    assert!(place.path().join("study-results/models/year/report.html").is_file());
    // Killed sweeps resume, and give the same bytes.
    let before = place.content("study-results/models/year/deployments/far/sweep");
    let results = place.path().join("study-results/models");
    for model in ["year", "narrow"] {
        for part in ["near", "far"] {
            let sweep = results.join(model).join("deployments").join(part).join("sweep");
            fs::remove_file(sweep.join("manifest.json")).expect("it is there");
            fs::remove_dir_all(sweep.join("units/PIT300/online")).expect("it is there");
        }
    }
    run(&place, &["sweep", "study.toml", "--threads", "1"]);
    assert!(place.content("study-results/models/year/deployments/far/sweep") == before);
}

#[test]
fn one_command_runs_them_all() {
    let models = "[models.knn]\n[models.network]\nmodel.kind = \"nn\"\n\
        dynamics = { hidden_units = 16, epochs = 2 }\n";
    let place = place("nearest", models);
    let dry = place.calib(&["run", "study.toml", "--dry-run"]);
    dry.succeeds();
    let ran = place.calib(&["run", "study.toml"]);
    assert!([0, 1].contains(&ran.code()), "{}{}", ran.stdout(), ran.stderr());
    assert!(ran.stdout().contains("what to deploy"), "{}", ran.stdout());
    for model in ["knn", "network"] {
        for part in ["near", "far"] {
            let directory = format!("study-results/models/{model}/deployments/{part}");
            let manifest = place.read_json(&format!("{directory}/rollout/manifest.json"));
            assert_eq!(manifest["comparison"]["against"], "deployment");
            assert!(place.path().join(directory).join("report.html").is_file());
        }
    }
    let again = place.calib(&["run", "study.toml", "-v"]);
    assert!(again.stderr().matches("up to date").count() >= 10, "{}", again.stderr());
}

#[test]
fn recent_states_and_months_are_of_each_deployment() {
    let place = place("recent", "");
    place.calib(&["build-model", "study.toml"]).succeeds();
    let recent = place.calib(&["rollout", "study.toml"]).succeeds();
    assert!(recent.contains("3 of 3 start states lie in the block that it leaves out"), "{recent}");
    // All training data precedes both deployments, so the runs in members are the same.
    place
        .calib(&["sweep", "study.toml"])
        .succeeds_with(&["66 training runs made", "18 training runs made"]);
    let month = ["rollout", "study.toml", "--set", "rollout.start=calendar_month"];
    assert_snapshot!("no_earlier_year", place.calib(&month).fails(2));
    let later = [&month[..], &["--set", "rollout.month=7"]].concat();
    place.calib(&later).fails_with(2, &["no rows in month 7 of a year before 2022"]);
}

#[test]
fn windows_that_do_not_fit_are_refused() {
    let place = place("random", "");
    let unknown = place.on_study("sweep", &["--deployment", "may"]).fails(2);
    assert_snapshot!("unknown_deployment", unknown);
    let of_models = place.on_study("build-model", &["--deployment", "near"]).fails(2);
    assert_snapshot!("no_deployment_of_models", of_models);
    place.calib(&["build-model", "study.toml"]).succeeds();
    let both = place.on_study("sweep", &["--json"]).fails(2);
    assert!(both.contains("add --deployment NAME (near, far)"), "{both}");
    let overlapping = "deployments.near={ start = 2022-11-02, end = 2022-11-04 }";
    assert_snapshot!("overlapping_deployment", place.refusal("sweep", overlapping));
    let held_out = place.refusal("sweep", "data.held_out={ start = 2022-11-03 }");
    assert!(held_out.contains("both given"), "{held_out}");
    let key = place.refusal("sweep", "deployments.near.begin=2022-11-03");
    assert!(key.contains("did you mean `start`") || key.contains("unknown key `begin`"), "{key}");
}

#[test]
fn a_deployment_that_the_log_does_not_have_is_left_out() {
    let place = place("nearest", "");
    place.edit_study("start = 2022-11-03T12:00:00\nend = 2022-11-04", "start = 2024-06-01");
    let ran = place.calib(&["run", "study.toml"]);
    let told = ran.stderr();
    assert_eq!(ran.code(), 1, "{told}");
    assert!(told.contains("deployment far is left out: [deployments.far]"), "{told}");
    assert!(told.contains("holds no rows: the log runs from"), "{told}");
    let judged = ran.stdout();
    assert!(judged.contains("note: deployment far is left out"), "{judged}");
}

#[test]
fn a_window_that_is_too_short_to_score_is_known_before_anything_is_trained() {
    let place = place("random", "");
    place.edit_study("end = 2022-11-04", "end = 2022-11-03T12:20:00");
    place.calib(&["build-model", "study.toml"]).succeeds();
    let dry = place.calib(&["sweep", "study.toml", "--deployment", "far", "--dry-run"]);
    let told = dry.stderr();
    assert_eq!(dry.code(), 1, "{told}");
    assert!(told.contains("deployment far is left out: the held-out period"), "{told}");
    assert!(told.contains("(2022-11-03T12:00:00 .. 2022-11-03T12:20:00)"), "{told}");
    // The other deployment is judged without it.
    let swept = place.calib(&["sweep", "study.toml"]);
    assert_eq!(swept.code(), 1, "{}", swept.stderr());
    let judged = place.calib(&["evaluate", "study.toml"]);
    assert!(judged.stdout().contains("deployment near"), "{}{}", judged.stdout(), judged.stderr());
    assert!(judged.stdout().contains("note: deployment far is left out"), "{}", judged.stdout());
    assert_eq!(judged.code(), 1, "as of the sweep");
    let quiet = place.calib(&["sweep", "study.toml", "--quiet"]);
    assert!(quiet.stderr().contains("deployment far is left out"), "{}", quiet.stderr());
    let page = place.content("study-results");
    let page = String::from_utf8(page[std::path::Path::new("report.html")].clone()).expect("text");
    assert!(page.contains("deployment far is left out"), "the report says so");
}
