//! Every mistake gives one message (what, where, what was expected, what to do) and exit code 2.

use std::fs;

use insta::assert_snapshot;

use crate::harness::Place;

#[test]
fn a_misspelt_key_is_named_with_its_neighbour() {
    let place = Place::with_study();
    place.edit_study("batch_size = 16", "batch_sise = 16");
    assert_snapshot!(place.calib(&["build-model", "study.toml"]).fails(2));
}

/// The mistakes, each with the name of its snapshot.
#[test]
fn mistakes_in_what_is_set_are_named() {
    let place = Place::with_study();
    for (name, command, set) in [
        ("a_misspelt_override_is_named", "sweep", "agent.gama=0.5"),
        ("a_value_out_of_range_is_named", "sweep", "agent.gamma=1.5"),
        ("no_files", "build-model", "data.path=nowhere/*.parquet"),
        ("a_wrong_timestamp_column", "build-model", "data.timestamp=when"),
        ("a_sensor_that_is_not_there", "build-model", "sweep.sensors=[\"PIT30\"]"),
        ("more_neighbours_than_a_member_has", "build-model", "model.neighbors=100000"),
    ] {
        assert_snapshot!(name, place.calib(&[command, "study.toml", "--set", set]).fails(2));
    }
}

#[test]
fn a_study_that_does_not_exist() {
    assert_snapshot!(Place::new().calib(&["sweep", "nowhere.toml"]).fails(2));
}

#[test]
fn a_truncated_file() {
    let place = Place::with_study();
    let path = place.path().join("data/2022-11-02.parquet");
    let whole = fs::read(&path).expect("readable");
    fs::write(&path, &whole[..whole.len() / 2]).expect("writable");
    assert_snapshot!(place.calib(&["build-model", "study.toml"]).fails(2));
    assert!(!place.path().join("study-results/model/manifest.json").exists());
}

#[test]
fn ranges_that_do_not_fit_are_named() {
    for (name, held_out) in [
        ("a_held_out_range_outside_the_data", "{ start = 2031-01-01, end = 2031-02-01 }"),
        ("ranges_that_overlap", "{ start = 2022-11-02, end = 2022-11-04 }"),
    ] {
        let place = Place::with_study();
        let train = "train = { start = 2022-11-01, end = 2022-11-03 }";
        place.edit_study("train_fraction = 0.7", &format!("{train}\nheld_out = {held_out}"));
        assert_snapshot!(name, place.calib(&["build-model", "study.toml"]).fails(2));
    }
}

#[test]
fn a_model_of_other_data() {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    place.simulate_other("other");
    let elsewhere = ["sweep", "study.toml", "--set", "data.path=other"];
    place.calib(&elsewhere).fails_with(2, &["other data", "build-model"]);
    // The same path with other content.
    fs::remove_dir_all(place.path().join("data")).expect("there");
    fs::rename(place.path().join("other"), place.path().join("data")).expect("there");
    place.calib(&["sweep", "study.toml"]).fails_with(2, &["other data", "build-model"]);
}

#[test]
fn a_model_that_was_not_built() {
    let place = Place::with_study();
    assert_snapshot!(place.calib(&["sweep", "study.toml"]).fails(2));
}

#[test]
fn a_model_of_other_settings_is_not_rolled_out() {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    let other = ["rollout", "study.toml", "--set", "preprocess.subsample=2"];
    place.calib(&other).fails_with(2, &["preprocess.subsample = 1, now 2"]);
}

#[test]
fn a_changed_file_of_the_model_is_found_and_made_again() {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    let path = place.path().join("study-results/model/states.npy");
    let mut states = fs::read(&path).expect("readable");
    let last = states.len() - 4;
    states[last..].copy_from_slice(&0.25_f32.to_le_bytes());
    fs::write(&path, states).expect("writable");
    place.calib(&["rollout", "study.toml"]).fails_with(2, &["states.npy is not what was written"]);
    let again = place.calib(&["build-model", "study.toml", "--verify", "5"]).succeeds();
    assert!(again.starts_with("wrote"), "{again}");
}

#[test]
fn a_sensor_twice_and_counts_of_zero() {
    let place = Place::with_study();
    assert!(place.refusal("sweep", "sweep.sensors=[\"A\", \"A\"]").contains("names A twice"));
    assert!(
        place
            .refusal("sweep", "sweep.member_runs=0")
            .contains("sweep.member_runs must be from 1 to")
    );
    assert!(
        place.refusal("sweep", "evaluate.top_k=0").contains("evaluate.top_k must be from 1 to")
    );
}

#[test]
fn slips_of_the_finger_are_refused_before_anything_starts() {
    let place = Place::with_study();
    assert!(
        place
            .refusal("rollout", "sweep.member_runs=9000000000000000000")
            .contains("sweep.member_runs must be")
    );
    assert!(
        place.refusal("rollout", "rollout.steps=100000000000000").contains("rollout.steps must be")
    );
    assert!(
        place.refusal("rollout", "rollout.rollouts=1000000").contains("rollout.rollouts must be")
    );
    assert!(place.refusal("rollout", "sweep.steps=[1").contains("is not a TOML value"));
    assert!(
        place.refusal("rollout", "data.train={start=2022-11-31}").contains("is not a TOML value")
    );
}

#[test]
fn a_damaged_model() {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    let path = place.path().join("study-results/model/members/1/neighbors.npy");
    let whole = fs::read(&path).expect("readable");
    fs::write(&path, &whole[..whole.len() - 7]).expect("writable");
    place.calib(&["rollout", "study.toml"]).fails_with(
        2,
        &["members/1/neighbors.npy is not what was written", "run `calib build-model study.toml`"],
    );
}

#[test]
fn an_output_that_cannot_be_written() {
    let place = Place::with_study();
    place.write("taken", "a file");
    assert_snapshot!(
        place.calib(&["build-model", "study.toml", "--output", "taken/results"]).fails(2)
    );
}

#[test]
fn a_sweep_that_was_not_run() {
    let place = Place::with_study();
    assert_snapshot!(place.calib(&["evaluate", "study.toml"]).fails(2));
}

#[test]
fn a_sweep_of_another_study() {
    let place = Place::with_study();
    place.run_steps(&["build-model", "sweep"]);
    assert_snapshot!(place.calib(&["evaluate", "study.toml", "--set", "agent.gamma=0.8"]).fails(2));
}

#[test]
fn streams_that_are_too_short_to_score() {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml"]).succeeds();
    // Sixteen rows are held out, and with gamma = 0.9 the last 44 returns of a piece are cut off.
    let short = ["sweep", "study.toml", "--set", "data.train_fraction=0.996"];
    let message = place.calib(&short).fails(2);
    assert!(message.contains("build-model"), "another model: {message}");
    place.edit_study("train_fraction = 0.7", "train_fraction = 0.996");
    place.calib(&["build-model", "study.toml"]).succeeds();
    let message = place.calib(&["sweep", "study.toml"]).fails(2);
    assert!(message.contains("is too short for gamma"), "{message}");
    assert!(!message.contains("sweep.scored"), "all steps are scored already: {message}");
    // `calib run` reports it before it builds anything.
    let place = Place::with_study();
    place.edit_study("train_fraction = 0.7", "train_fraction = 0.996");
    place.calib(&["run", "study.toml"]).fails_with(2, &["is too short for gamma"]);
    assert!(!place.path().join("study-results/model").exists(), "nothing was built");
}

#[test]
fn a_directory_with_other_files_is_not_simulated_into() {
    let place = Place::new();
    place.simulate("data");
    let message = place.calib(&["simulate", "data", "--days", "1"]).fails(2);
    assert!(message.contains("another simulation") && message.contains("--force"), "{message}");
    fs::remove_file(place.path().join("data/simulation.json")).expect("there");
    place.calib(&["simulate", "data", "--days", "1"]).fails_with(2, &["did not simulate"]);
}

#[test]
fn two_commands_do_not_write_to_one_place() {
    let place = Place::with_study();
    let model = place.path().join("study-results/model");
    place.calib(&["build-model", "study.toml"]).succeeds();
    fs::remove_file(model.join("manifest.json")).expect("there");
    let lock = fs::File::open(model.join(".lock")).expect("there");
    lock.lock().expect("nobody else has it");
    place.calib(&["build-model", "study.toml"]).fails_with(2, &["another calib is writing"]);
    drop(lock);
    place.calib(&["build-model", "study.toml"]).succeeds();
}

#[test]
fn wrong_usage() {
    let place = Place::new();
    assert_eq!(place.calib(&["sweeep"]).code(), 2);
    assert_eq!(place.calib(&["simulate", "x", "--channels", "1"]).code(), 2);
    assert_eq!(place.calib(&["simulate", "x", "--start", "soon"]).code(), 2);
    assert_eq!(place.calib(&["inspect", "x", "--threads", "0"]).code(), 2);
    assert_eq!(place.calib(&["--help"]).code(), 0);
}

/// Frequent first attempts: a log in place of a study, and a folder of workbooks.
#[test]
fn a_log_is_no_study_and_a_workbook_no_log() {
    let place = Place::new();
    place.write("plant.csv", "time,a\n2024-01-01,1\n");
    place.calib(&["run", "plant.csv"]).fails_with(2, &["`calib init plant.csv` writes one"]);
    fs::create_dir(place.path().join("sheets")).expect("created");
    place.write("sheets/plant.xlsx", "PK");
    let error = place.calib(&["init", "sheets", "study.toml"]).fails(2);
    assert!(error.contains("plant.xlsx is a workbook: save each sheet as CSV"), "{error}");
}

#[test]
fn a_folder_in_the_place_of_a_study_is_told_which_file_to_give() {
    let place = Place::with_study();
    for folder in ["study-results", "elsewhere", "logs"] {
        fs::create_dir(place.path().join(folder)).expect("made");
    }
    place.write("elsewhere/b.toml", "");
    place.write("elsewhere/a.toml", "");
    place.write("logs/log.csv", "time,a\n");
    for (folder, told) in [
        ("study-results", "give study.toml, which these results are of"),
        ("elsewhere", "such as elsewhere/a.toml"),
        ("logs", "if it holds a log, `calib init logs` writes one"),
    ] {
        place.calib(&["evaluate", folder]).fails_with(2, &["this is a folder", told]);
    }
}
