//! Models that are networks, through all steps.

use std::{fs, thread, time::Duration};

use calib_files::{
    fingerprint_file, read_sealed_json, read_tensors, write_sealed_json, write_tensors,
};

#[cfg(feature = "torch")]
use crate::harness::Ran;
use crate::harness::{Place, assert_same};

/// Returns the study of the other tests with a small network as its model.
fn place() -> Place {
    let place = Place::with_study();
    place.edit_study(
        "members = 3\nexclude_self = true",
        "kind = \"nn\"\n\n[dynamics]\nhidden_units = 32\nepochs = 15",
    );
    place
}

fn json(place: &Place, file: &str) -> serde_json::Value {
    place.read_json(&format!("study-results/{file}"))
}

#[test]
fn a_network_goes_through_the_chain() {
    let place = place();
    place.calib(&["build-model", "study.toml"]).succeeds_with(&["of 15, one-step validation loss"]);
    let training = &json(&place, "model/manifest.json")["training"];
    let [loss, of_persistence] = ["validation_loss", "persistence_loss"]
        .map(|name| training[name].as_f64().expect("a number"));
    assert!(loss < 2.0 * of_persistence, "{training}");
    assert_eq!(json(&place, "model/training.json")["epochs"].as_array().expect("list").len(), 15);
    assert!(!place.path().join("study-results/model/checkpoint.safetensors").exists());

    place.calib(&["rollout", "study.toml"]).succeeds_with(&["member 0: predictions", "symmetric2"]);
    let collapse = &json(&place, "rollout/manifest.json")["collapse"];
    assert_eq!(collapse["rollouts"], 2);
    assert_eq!(collapse["sensors"].as_array().expect("a list").len(), 2);
    place.calib(&["sweep", "study.toml"]).succeeds();
    place.calib(&["evaluate", "study.toml", "--why"]).succeeds_with(&["NN ranks it"]);
    assert!(place.path().join("study-results/report.html").is_file());
    assert!(place.calib(&["build-model", "study.toml"]).succeeds().contains("up to date"));
}

#[test]
fn another_seed_is_another_network() {
    let place = place();
    place.calib(&["build-model", "study.toml"]).succeeds();
    place.edit_study("seed = ", "seed = 1");
    for command in ["rollout", "sweep"] {
        place
            .calib(&[command, "study.toml"])
            .fails_with(2, &["made with seed = ", "run `calib build-model"]);
    }
    assert!(place.calib(&["build-model", "study.toml"]).succeeds().contains("wrote"));
    place.calib(&["rollout", "study.toml"]).succeeds();
}

#[test]
fn rollouts_that_end_at_once_are_left_out_and_told() {
    let place = place();
    place.calib(&["build-model", "study.toml"]).succeeds();
    let path = place.path().join("study-results/model/weights.safetensors");
    let mut weights = read_tensors(&path).expect("weights");
    for tensor in &mut weights.tensors {
        tensor.values.iter_mut().for_each(|value| *value = 1e30);
    }
    write_tensors(&path, &weights).expect("written");
    // The manifest is changed to match these weights.
    let manifest = place.path().join("study-results/model/manifest.json");
    let mut sealed = read_sealed_json::<serde_json::Value>(&manifest).expect("sealed");
    let fingerprint = fingerprint_file(&path).expect("readable");
    sealed["files"]["weights.safetensors"] = fingerprint.as_str().into();
    write_sealed_json(&manifest, &sealed).expect("written");
    let told = place.calib(&["rollout", "study.toml"]).succeeds();
    assert!(told.contains("2 of 2 rollouts not compared: they ended before"), "{told}");
    let comparison = &json(&place, "rollout/manifest.json")["comparison"];
    assert_eq!((&comparison["rollouts"], &comparison["ended_early"]), (&0.into(), &2.into()));
}

#[test]
fn networks_are_the_same_bytes_for_any_number_of_threads() {
    let place = place();
    for (threads, output) in [("1", "one"), ("4", "four")] {
        for command in ["build-model", "rollout", "sweep"] {
            let args = [command, "study.toml", "--output", output, "--threads", threads];
            place.calib(&args).succeeds();
        }
    }
    assert_same(&place.content("one"), &place.content("four"));
}

#[test]
fn killed_training_goes_on_to_the_same_bytes() {
    let place = place();
    let args = ["build-model", "study.toml", "--set", "dynamics.epochs=60"];
    place.calib(&[&args[..], &["--output", "whole"]].concat()).succeeds();
    let args = [&args[..], &["--output", "killed"]].concat();
    let mut kills = 0;
    let checkpoint = place.path().join("killed/model/checkpoint.safetensors");
    for round in 1..40_u64 {
        let mut child = place.command(&args).spawn().expect("calib runs");
        // Waits for a checkpoint to resume from, and each time a little longer.
        for _ in 0..10_000 {
            if checkpoint.exists() || child.try_wait().expect("a status").is_some() {
                break;
            }
            thread::sleep(Duration::from_millis(2));
        }
        thread::sleep(Duration::from_millis(3 * round));
        if child.try_wait().expect("a status").is_some() {
            break;
        }
        child.kill().expect("it runs");
        child.wait().expect("it ends");
        kills += usize::from(checkpoint.exists());
    }
    let ended = place.calib(&args);
    ended.succeeds();
    assert!(kills > 0, "killed at least once in the middle of training");
    assert!(place.content("whole") == place.content("killed"));
}

#[test]
fn other_settings_are_another_model() {
    let place = place();
    place.calib(&["build-model", "study.toml"]).succeeds();
    let set = ["--set", "dynamics.learning_rate=1e-2"];
    place
        .calib(&[&["rollout", "study.toml"], &set[..]].concat())
        .fails_with(2, &["dynamics.learning_rate = ", "build-model"]);
    // A key that this kind of model does not use changes nothing.
    let set = ["--set", "dynamics.sequence_length=7"];
    let built = place.calib(&[&["build-model", "study.toml"], &set[..]].concat()).succeeds();
    assert!(built.contains("up to date"), "{built}");
    place.calib(&["build-model", "study.toml", "--verify", "5"]).fails_with(2, &["--verify"]);
    let epochs = ["build-model", "study.toml", "--set", "dynamics.epochs=0"];
    place.calib(&epochs).fails_with(2, &["`epochs` must be a whole number from 1"]);
}

#[cfg(not(feature = "torch"))]
#[test]
fn what_wants_libtorch_says_how_to_get_it() {
    let place = place();
    place.calib(&["build-model", "study.toml"]).succeeds();
    let before = place.content("study-results");
    let script = ["--set", "dynamics.path=model.pt"];
    let wanting: [&[&str]; 2] = [&["--set", "model.kind=torchscript"], &["--device", "auto"]];
    for args in wanting {
        let args = [&["build-model", "study.toml"], args, &script].concat();
        place
            .calib(&args)
            .fails_with(2, &["bash scripts/libtorch.sh cargo build", "--features torch"]);
    }
    let mlp = ["--set", "agent.value_function=mlp", "--set", "model.kind=knn"];
    for command in ["sweep", "run"] {
        let args = [&[command, "study.toml", "--device", "cpu"], &mlp[..]].concat();
        place.calib(&args).fails_with(2, &["--device wants libtorch"]);
    }
    assert!(place.content("study-results") == before, "nothing was touched");
}

#[test]
fn a_gru_goes_through_the_chain() {
    let place = place();
    let small = "dynamics.sequence_stride=7";
    let set = ["--set", "model.kind=gru", "--set", small, "--set", "dynamics.epochs=4"];
    place.on_study("build-model", &set).succeeds_with(&["of 4, one-step validation loss"]);
    place.on_study("rollout", &set).succeeds_with(&["member 0: predictions"]);
    place.on_study("sweep", &set).succeeds();
    let judged = place.on_study("evaluate", &[&["--why"], &set[..]].concat());
    assert!(judged.succeeds().contains("GRU ranks it"));
    assert!(place.on_study("build-model", &set).succeeds().contains("up to date"));
}

/// Runs all steps with a kind of noise, and returns the table of trajectories.
fn trajectories_with(place: &Place, noise: &str) -> Vec<u8> {
    // The weights do not depend on the noise.
    assert!(place.on_study_with("build-model", noise).succeeds().contains("up to date"));
    place.on_study_with("rollout", noise).succeeds();
    let path = place.path_of("study-results/rollout/trajectories.parquet");
    let table = fs::read(path).expect("written");
    place.on_study_with("sweep", noise).succeeds();
    place.on_study_with("evaluate", noise).succeeds();
    table
}

/// A network whose rollouts use means comes to rest. With recorded residuals it keeps moving.
#[test]
fn residuals_keep_rollouts_moving() {
    let place = place();
    place.calib(&["build-model", "study.toml"]).succeeds();
    let still = trajectories_with(&place, "dynamics.noise=none");
    let moving = trajectories_with(&place, "dynamics.noise=residual");
    let blocks = trajectories_with(&place, "dynamics.noise=block");
    assert!(still != moving && moving != blocks);
    assert!(trajectories_with(&place, "dynamics.noise=residual") == moving, "the same seeds");
}

#[cfg(feature = "torch")]
#[test]
fn native_and_libtorch_training_agree_about_the_model() {
    let place = place();
    place.on_study("build-model", &["--output", "native"]).succeeds();
    place.on_study("build-model", &["--output", "torch", "--device", "cpu"]).succeeds();
    let [native, torch] =
        ["native", "torch"].map(|output| place.read_json(&format!("{output}/model/manifest.json")));
    assert_eq!(native["key"], torch["key"]);
    let a = validation_loss(&native);
    let b = validation_loss(&torch);
    assert!((a - b).abs() < 0.02 * a, "{a} {b}");
}

/// Returns the loss on the validation data.
#[cfg(feature = "torch")]
fn validation_loss(manifest: &serde_json::Value) -> f64 {
    manifest["training"]["validation_loss"].as_f64().expect("a number")
}

/// Options for a study of neighbours whose agents are networks.
#[cfg(feature = "torch")]
const NEIGHBOURS: [&str; 3] =
    ["--set=model.kind=knn", "--set=agent.value_function=mlp", "--set=agent.hidden_units=8"];

/// Runs a command on the study with a model of neighbours.
#[cfg(feature = "torch")]
fn with_neighbours(place: &Place, command: &str, more: &[&str]) -> Ran {
    place.on_study(command, &[&NEIGHBOURS[..], more].concat())
}

#[cfg(feature = "torch")]
#[test]
fn agents_that_libtorch_trains_are_results_of_their_own() {
    let place = place();
    with_neighbours(&place, "build-model", &[]).succeeds();
    let device = ["--device", "cpu"];
    assert!(with_neighbours(&place, "sweep", &device).succeeds().contains("training runs made in"));
    assert_eq!(json(&place, "sweep/manifest.json")["arithmetic"], "libtorch-cpu");
    assert!(with_neighbours(&place, "sweep", &device).succeeds().contains("up to date"));
    // The verdict is that of the device, and says so.
    let summary = with_neighbours(&place, "evaluate", &["--json"]).json(&[0, 1]);
    assert!(summary["choices"].as_array().is_some_and(|choices| !choices.is_empty()), "{summary}");
    assert!(summary.to_string().contains("libtorch-cpu"), "{summary}");
    let page = place.read("study-results/report.html");
    assert!(page.contains("--device cpu"), "the report says how it was made");
    // Native runs are separate results, and those of the device stay.
    assert!(with_neighbours(&place, "sweep", &[]).succeeds().contains("training runs made in"));
    assert_eq!(json(&place, "sweep/manifest.json").get("arithmetic"), None);
    assert!(with_neighbours(&place, "sweep", &device).succeeds().contains("up to date"));
    // A dry run distinguishes between them.
    let planned = with_neighbours(&place, "run", &[&device[..], &["--dry-run"]].concat()).stderr();
    assert!(planned.contains("up to date: "));
    let planned = with_neighbours(&place, "run", &["--dry-run"]).stderr();
    assert!(!planned.split("to do").next().unwrap_or_default().contains("sweep"));
}

#[cfg(feature = "torch")]
#[test]
fn what_a_device_cannot_train_is_refused_before_anything_is_made() {
    let place = place();
    for set in [
        ["--set=model.kind=knn", "--set=agent.value_function=linear"],
        ["--set=agent.value_function=mlp", "--set=agent.precision=bf16"],
    ] {
        place
            .on_study("run", &[&["--device", "cpu"], &set[..]].concat())
            .fails_with(2, &["are not trained side by side; leave --device out"]);
    }
    assert!(!place.path().join("study-results").exists(), "nothing was made");
}
