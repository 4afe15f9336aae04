//! A result stays valid as long as its inputs are the same, and for no other reason.

use std::{fs, path::Path};

use crate::harness::Place;

/// All steps of the study before the verdict.
const STEPS: [&str; 3] = ["build-model", "rollout", "sweep"];

#[test]
fn what_changes_no_byte_changes_no_key() {
    let place = Place::with_study();
    place.run_steps(&STEPS);
    let before = place.content("study-results");
    for command in ["build-model", "rollout"] {
        let again = place.on_study_with(command, "model.index=scan").succeeds();
        assert!(again.starts_with("up to date"), "{command}: {again}");
    }
    let swept = place.on_study_with("sweep", "model.index=scan");
    assert!(swept.succeeds().starts_with("up to date"), "{}", swept.stdout());
    let judged = place.on_study_with("evaluate", "model.index=scan");
    judged.ends(&[0, 1]);
    assert!(!judged.stdout().contains("other settings"), "{}", judged.stdout());
    let after = place.content("study-results");
    // These files name the study that they were made for.
    let tells_study =
        |path: &Path| path.ends_with("manifest.json") || path.ends_with("planned.json");
    for (path, content) in before.iter().filter(|(path, _)| !tells_study(path)) {
        assert!(after[path] == *content, "{}", path.display());
    }
}

#[test]
fn a_log_is_known_by_what_it_holds() {
    let place = Place::with_study();
    place.run_steps(&STEPS);
    // The same log in another folder.
    fs::rename(place.path().join("data"), place.path().join("moved")).expect("there");
    place.on_study_with("evaluate", "data.path=moved").ends(&[0, 1]);
    for command in ["rollout", "sweep", "build-model"] {
        let again = place.on_study_with(command, "data.path=moved").succeeds();
        assert!(again.starts_with("up to date"), "{command}: {again}");
    }
    let judged = place.on_study_with("evaluate", "data.path=moved");
    judged.ends(&[0, 1]);
    assert!(!judged.stdout().contains("other settings"), "{}", judged.stdout());
    // Another log, in a folder with another name.
    place.simulate_other("other");
    for command in ["rollout", "sweep", "evaluate"] {
        place
            .on_study_with(command, "data.path=other")
            .fails_with(2, &["other data", "'data.path=other'"]);
    }
}

#[test]
fn a_variable_may_mean_another_log() {
    let place = Place::with_study();
    place.edit_study("path = \"data\"", "path = \"${PLANT}\"");
    let [data, other] = [[("PLANT", "data")], [("PLANT", "other")]];
    for command in STEPS {
        place.calib_with(&[command, "study.toml"], &data).succeeds();
    }
    place.simulate_other("other");
    for command in ["rollout", "evaluate"] {
        let message = place.calib_with(&[command, "study.toml"], &other).fails(2);
        assert!(message.contains("other data"), "{command}: {message}");
    }
    place.calib_with(&["evaluate", "study.toml"], &data).ends(&[0, 1]);
    let check = ["check", "study-results", "--read-data"];
    place.calib_with(&check, &data).succeeds();
    let unset = place.calib(&check);
    unset.ends(&[1]);
    let told = unset.stdout();
    assert!(told.contains("cannot be read: "), "{told}");
    assert!(told.contains("the environment variable PLANT is not set"), "{told}");
    assert!(told.contains("damaged or missing: 0"), "the log is no result: {told}");
}

#[test]
fn the_keys_that_differ_are_named_with_both_values() {
    let place = Place::with_study();
    place.run_steps(&STEPS);
    let refused =
        |command: &str, set: &str| place.calib(&[command, "study.toml", "--set", set]).fails(2);
    let message = refused("evaluate", "agent.gamma=0.8");
    assert!(
        message.contains(
            "agent.gamma = 0.9, now 0.8; run `calib sweep study.toml --set 'agent.gamma=0.8'`"
        ),
        "{message}"
    );
    let message = refused("sweep", "model.neighbors=7");
    assert!(
        message.contains("model.neighbors = 3, now 7; run `calib build-model study.toml --set"),
        "{message}"
    );
    let message = refused("rollout", "preprocess.fill_limit=6");
    assert!(message.contains("preprocess.fill_limit = 5, now 6"), "{message}");
    // Rollouts with other settings are mentioned, but not shown.
    let note = place.calib(&["evaluate", "study.toml", "--set", "rollout.steps=399"]);
    note.ends(&[0, 1]);
    assert!(note.stdout().contains("with other settings"), "{}", note.stdout());
}
