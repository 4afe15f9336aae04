//! Simple predictors: beside every verdict, and as the starting point of agents.

use std::fs;

use serde_json::Value;

use crate::harness::{Place, assert_same};

const GRID: &str = "[1e-5, 1e-3, 1e-2]";

/// Returns a study of agents that start from `baseline`; one of them stays there.
fn place(baseline: &str) -> Place {
    let place = Place::with_study();
    place.edit_study("[agent]", &format!("[agent]\nbaseline = \"{baseline}\""));
    place.edit_study(GRID, "[0, 1e-5, 1e-3]");
    place
}

fn summary(place: &Place) -> Value {
    place.run_steps(&["build-model", "sweep"]);
    place.calib(&["evaluate", "study.toml"]).succeeds();
    place.read_json("study-results/evaluate/summary.json")
}

#[test]
fn an_agent_that_does_not_learn_has_the_error_of_its_baseline() {
    for name in ["mean", "persistence", "line", "autoregression", "ridge", "least_squares_td"] {
        let summary = summary(&place(name));
        for verdict in summary["verdicts"].as_array().expect("a list") {
            let simple = verdict["simple"].as_array().expect("a list");
            let own = simple.iter().find(|score| score["predictor"] == name).expect("scored");
            let frozen = verdict["truth"]["scores"]["candidates"][0]["mean"].as_f64();
            let own = own["online_error"].as_f64();
            let (own, frozen) = own.zip(frozen).expect("numbers");
            // The mean of three equal runs is rounded.
            assert!((own - frozen).abs() < 1e-12, "{name}: {own} {frozen}");
        }
    }
}

#[test]
fn every_choice_says_what_to_do() {
    let place = Place::with_study();
    let summary = summary(&place);
    for choice in summary["choices"].as_array().expect("a list") {
        let is_beaten = choice["grade"] == "simpler";
        assert_eq!(choice["recommendation"] == "use_simple_predictor", is_beaten, "{choice}");
        assert_eq!(
            choice["simple_predictor"].is_object(),
            is_beaten || choice["grade"] == "not_learnt"
        );
    }
    let text = summary["advice"].to_string();
    assert!(text.contains("NRMSE of simple predictors"), "{text}");
    // The page shows the same grades.
    let page = place.read("study-results/report.html");
    let shown: Vec<&str> = page
        .split("<article class=\"card ")
        .skip(1)
        .filter_map(|card| card.split_once('"').map(|(class, _)| class))
        .collect();
    let grades: Vec<&str> = summary["choices"]
        .as_array()
        .into_iter()
        .flatten()
        .map(|choice| match choice["grade"].as_str().expect("a grade") {
            "not_learnt" => "poor",
            grade => grade,
        })
        .collect();
    assert_eq!(shown, grades);
}

#[test]
fn a_verdict_says_where_its_agent_starts_if_it_names_another_predictor() {
    let place = place("best");
    let summary = summary(&place);
    let best = place.read_json("study-results/sweep/simple.json")["best"].clone();
    let choices = summary["choices"].as_array().expect("a list");
    let mut told = 0;
    for (choice, plain) in choices.iter().zip(summary["plain"].as_array().expect("a list")) {
        let start = &best[choice["sensor"].as_str().expect("a name")];
        assert!(start.is_string(), "{best}");
        if choice["grade"] == "simpler" {
            let is_told = plain.as_str().is_some_and(|text| text.contains("The agent starts from"));
            assert_eq!(is_told, choice["simple_predictor"]["predictor"] != *start, "{plain}");
            told += usize::from(is_told);
        }
    }
    assert!(told > 0, "one of the sensors has another start: {summary}");
}

#[test]
fn without_held_out_data_no_agent_is_named_that_a_simple_predictor_beats_on_the_log() {
    let place = Place::with_study();
    place.edit_study("train_fraction = 0.7", "train_fraction = 1.0");
    place.edit_study("log_replay_runs = 2", "log_replay_runs = 6");
    place.run_steps(&["build-model", "sweep"]);
    let set = ["--set", "evaluate.rule=log_replay"];
    let told = place.calib(&[&["evaluate", "study.toml", "--why"][..], &set].concat()).succeeds();
    let summary = place.read_json("study-results/evaluate/summary.json");
    let mut beaten = 0;
    for (choice, verdict) in summary["choices"]
        .as_array()
        .expect("a list")
        .iter()
        .zip(summary["verdicts"].as_array().expect("a list"))
    {
        let simple = verdict["simple"].as_array().expect("a list");
        assert_eq!(simple.len(), 6, "{verdict}");
        assert!(simple.iter().all(|own| own["log_windows"].is_u64()), "{verdict}");
        let is_beaten = simple
            .iter()
            .any(|own| own["ratio"]["interval"]["low"].as_f64().is_some_and(|low| low > 1.0));
        let is_agent = ["deploy", "keep_default", "not_checked"]
            .iter()
            .any(|agent| choice["recommendation"] == *agent);
        assert!(!(is_beaten && is_agent), "{choice}");
        beaten += usize::from(is_beaten);
    }
    // Agents of 800 steps do not even reach the level of the sensors.
    assert!(beaten > 0, "{summary}");
    assert!(told.contains("on the evidence of the log: "), "{told}");
    assert!(told.contains("on windows of the log, as geometric means: "), "{told}");
    assert!(told.contains("No data was held out"), "{told}");
}

#[test]
fn pre_trained_agents_keep_their_baseline() {
    let place = place("ridge");
    place.edit_study(
        "[sweep]",
        "[pretrain]\nepochs = 2\nlearning_rate = 1e-4\nfraction = 0.4\n\n[sweep]",
    );
    place.calib(&["pretrain", "study.toml"]).succeeds();
    let manifest = place.read_json("study-results/pretrain/manifest.json");
    assert_eq!(manifest["agents"][0]["baseline"]["form"], "affine");
    summary(&place);
    let other = place.calib(&["sweep", "study.toml", "--set", "agent.baseline=\"line\""]).fails(2);
    assert!(other.contains("agent.baseline"), "{other}");
}

#[test]
fn shards_fit_the_baselines_of_one_process() {
    let place = place("ridge");
    place.run_steps(&["build-model", "sweep"]);
    let alone = place.content("study-results/sweep");
    fs::remove_dir_all(place.path().join("study-results/sweep")).expect("there");
    place.calib(&["cluster", "plan", "study.toml", "--shards", "3", "-o", "plan"]).succeeds();
    for shard in ["0", "1", "2"] {
        place.calib(&["cluster", "run", "plan", "--shard", shard]).succeeds();
    }
    place.calib(&["cluster", "merge", "plan"]).succeeds();
    assert_same(&alone, &place.content("study-results/sweep"));
}

#[test]
fn an_unknown_baseline_is_refused_with_the_known_ones() {
    let place = Place::with_study();
    place
        .calib(&["sweep", "study.toml", "--set", "agent.baseline=\"last\""])
        .fails_with(2, &["baseline", "persistence"]);
}
