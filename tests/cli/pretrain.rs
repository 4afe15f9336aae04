//! Pre-trained agents: from the log to a step size for fine-tuning.

use std::{fs, path::Path};

use insta::assert_snapshot;

use crate::harness::Place;

const SECTION: &str = "[pretrain]\nepochs = 6\nlearning_rate = 1e-3\nfraction = 0.4\n\n[sweep]";

fn place() -> Place {
    let place = Place::with_study();
    place.edit_study("[sweep]", SECTION);
    place.edit_study("[1e-5, 1e-3, 1e-2]", "[0, 1e-5, 1e-3, 1e-2]");
    place
}

#[test]
fn a_sweep_starts_from_what_was_pre_trained() {
    let place = place();
    let wrote = place.on_study("pretrain", &[]).succeeds();
    assert!(wrote.contains("wrote") && wrote.contains("6 of 6"), "{wrote}");
    assert!(place.on_study("pretrain", &[]).succeeds().contains("up to date"));
    let built = place.calib(&["build-model", "study.toml"]);
    assert!(built.stderr().contains("is for pre-training"), "{}", built.stderr());
    place.on_study("rollout", &[]).succeeds();
    place.on_study("sweep", &[]).succeeds();
    assert!(place.on_study("sweep", &[]).succeeds().contains("up to date"));
    let verdict = place.on_study("evaluate", &[]).succeeds();
    assert!(
        verdict.contains("note: agents start from what they learned from 2022-11-01"),
        "{verdict}"
    );
    for file in ["PIT300.safetensors", "TIT101.moments.safetensors", "curves.parquet"] {
        let path = place.path().join("study-results/pretrain").join(file);
        assert!(path.is_file(), "{file} is missing");
    }
    assert!(place.read("study-results/report.html").contains("calib pretrain"));

    // Another sensor needs one more agent, and the two existing agents stay unchanged.
    let before = place.content("study-results/pretrain");
    place.edit_study("[\"PIT300\", \"TIT101\"]", "[\"PIT300\", \"TUIT101\", \"TIT101\"]");
    let more = place.calib(&["pretrain", "study.toml"]);
    assert!(more.stderr().contains("1 of 3 agents left"), "{}", more.stderr());
    let after = place.content("study-results/pretrain");
    for (path, content) in before.iter().filter(|(path, _)| path.to_string_lossy().contains("01.s"))
    {
        assert!(after[path] == *content, "{}", path.display());
    }
    place.on_study("pretrain", &["--force"]).succeeds();
    assert!(place.content("study-results/pretrain") == after, "made again, it is the same");

    // Kept moments, other periods and other agents are other inputs.
    place.on_study("sweep", &[]).succeeds();
    let moments = place.on_study("sweep", &["--dry-run", "--set=pretrain.moments=keep"]);
    assert!(moments.stderr().contains("; all "));
    place
        .on_study("sweep", &["--dry-run", "--set=pretrain.fraction=0.3"])
        .fails_with(2, &["pretrain.fraction = 0.4, now 0.3"]);
    place
        .on_study("sweep", &["--dry-run", "--set=pretrain.epochs=7"])
        .fails_with(2, &[", now 7; run `calib pretrain"]);
}

#[test]
fn agents_of_another_study_can_be_taken() {
    let place = place();
    place.calib(&["pretrain", "study.toml"]).succeeds();
    let study = place.read("study.toml");
    let other = study.replace("epochs = 6\n", "checkpoint = \"study-results/pretrain\"\n");
    place.write("other.toml", &other);
    for study in ["study.toml", "other.toml"] {
        for command in ["build-model", "sweep"] {
            place.calib(&[command, study]).succeeds();
        }
    }
    assert!(
        place.content("study-results/sweep/units") == place.content("other-results/sweep/units")
    );
    place.calib(&["pretrain", "other.toml"]).fails_with(2, &["there is nothing to pre-train"]);
}

/// Asserts that a sweep with these keys set is refused, and returns the error message.
fn refused_sweep(place: &Place, set: &[&str]) -> String {
    let set: Vec<&str> = set.iter().flat_map(|set| ["--set", set]).collect();
    place.on_study("sweep", &set).fails(2)
}

#[test]
fn what_does_not_fit_is_refused() {
    let place = place();
    let overlap = [
        "pretrain",
        "study.toml",
        "--set=pretrain.period={ start = 2022-11-01, end = 2022-11-02 }",
        "--set=model.period={ start = 2022-11-01T18:00:00, end = 2022-11-03 }",
    ];
    assert_snapshot!("overlapping_periods", place.calib(&overlap).fails(2));
    place.calib(&["build-model", "study.toml"]).succeeds();
    assert_snapshot!("no_agents", refused_sweep(&place, &[]));
    place.calib(&["pretrain", "study.toml"]).succeeds();
    assert_snapshot!("another_gamma", refused_sweep(&place, &["agent.gamma=0.5"]));
    assert_snapshot!("another_sensor", refused_sweep(&place, &["sweep.sensors=[\"TUIT101\"]"]));
    let taken = "pretrain={ checkpoint = \"study-results/pretrain\", fraction = 0.4 }";
    assert_snapshot!("another_shape", refused_sweep(&place, &[taken, "agent.value_function=mlp"]));
    let sensor = refused_sweep(&place, &[taken, "sweep.sensors=[\"TUIT101\"]"]);
    assert!(sensor.contains("it has PIT300, TIT101; pre-train there, or correct"), "{sensor}");
    place
        .calib(&["build-model", "study.toml", "--set", "preprocess.normalise=standard"])
        .succeeds();
    let columns = refused_sweep(&place, &[taken, "preprocess.normalise=standard"]);
    assert!(columns.contains("was normalised otherwise"), "{columns}");
    place.calib(&["build-model", "study.toml"]).succeeds();
    let weights = place.path().join("study-results/pretrain/PIT300.safetensors");
    fs::write(&weights, b"damaged").expect("writable");
    assert!(
        refused_sweep(&place, &[]).contains("run `calib pretrain study.toml` to make it again")
    );
    let damaged = refused_sweep(&place, &[taken]);
    assert!(
        damaged.contains("for PIT300 in study-results/pretrain are missing, damaged"),
        "{damaged}"
    );
    assert!(damaged.contains("; pre-train there, or correct"), "{damaged}");
    assert!(!damaged.contains("calib pretrain"), "{damaged}");
    let none = place.calib(&["pretrain", "study.toml", "--set", "pretrain.epochs=0"]).fails(2);
    assert!(none.contains("pretrain.epochs is 0"), "{none}");
    let diverged = ["pretrain", "study.toml", "--set", "pretrain.learning_rate=1e38"];
    let told = place.calib(&diverged).fails(1);
    for sensor in ["PIT300", "TIT101"] {
        let expected = format!("pre-training for {sensor} diverged in epoch 1");
        assert!(told.contains(&expected), "{told}");
    }
}

#[test]
fn early_stopping_keeps_the_best_epoch() {
    let place = place();
    let set = ["--set", "pretrain.epochs=400", "--set", "pretrain.patience=2"];
    let args = [&["pretrain", "study.toml", "--json", "-q"], set.as_slice()].concat();
    let manifest = place.calib(&args).json(&[0]);
    for agent in manifest["agents"].as_array().expect("a list") {
        let epoch = &agent["epoch"];
        let epochs = agent["curve"].as_array().expect("a list").len();
        assert!(epochs < 400, "{epochs}");
        assert_eq!(epoch.as_u64().expect("a number") + 2, epochs as u64);
    }
}

#[test]
fn agents_are_pre_trained_with_the_gammas_of_their_sensors() {
    let place = place();
    let set = "agent.gammas={ TIT101 = 0.8 }";
    let studies = [("near", "agent.gamma=0.9"), ("far", "agent.gamma=0.8"), ("both", set)];
    let [near, far, both] = studies.map(|(output, set)| {
        place.on_study("pretrain", &["--output", output, "--set", set]).succeeds();
        place.content(&format!("{output}/pretrain"))
    });
    for (name, alone) in [("PIT300.safetensors", &near), ("TIT101.safetensors", &far)] {
        let file = Path::new(name);
        assert!(both[file] == alone[file], "{name}");
        assert!(near[file] != far[file], "{name}");
    }
    place.calib(&["run", "study.toml", "--output", "both", "--set", set]).ends(&[0, 1]);
}
