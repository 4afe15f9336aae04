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
    let run = |args: &[&str]| place.calib(&[args, &["study.toml"]].concat()).succeeds();
    let wrote = run(&["pretrain"]);
    assert!(wrote.contains("wrote") && wrote.contains("6 of 6"), "{wrote}");
    assert!(run(&["pretrain"]).contains("up to date"));
    let built = place.calib(&["build-model", "study.toml"]);
    assert!(built.stderr().contains("is for pre-training"), "{}", built.stderr());
    run(&["rollout"]);
    run(&["sweep"]);
    assert!(run(&["sweep"]).contains("up to date"));
    let verdict = run(&["evaluate"]);
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
    run(&["pretrain", "--force"]);
    assert!(place.content("study-results/pretrain") == after, "made again, it is the same");

    // Kept moments, other periods and other agents are other inputs.
    run(&["sweep"]);
    let dry = |set: &str| place.calib(&["sweep", "study.toml", "--dry-run", "--set", set]);
    assert!(dry("pretrain.moments=keep").stderr().contains("; all "));
    dry("pretrain.fraction=0.3").fails_with(2, &["pretrain.fraction = 0.4, now 0.3"]);
    assert!(dry("pretrain.epochs=7").fails(2).contains(", now 7; run `calib pretrain"));
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
    let units = |study: &str| place.content(&format!("{study}-results/sweep/units"));
    assert!(units("study") == units("other"));
    place.calib(&["pretrain", "other.toml"]).fails_with(2, &["there is nothing to pre-train"]);
}

#[test]
fn what_does_not_fit_is_refused() {
    let place = place();
    let sweep = |set: &[&str]| {
        let set: Vec<&str> = set.iter().flat_map(|set| ["--set", set]).collect();
        place.calib(&[&["sweep", "study.toml"], set.as_slice()].concat()).fails(2)
    };
    let overlap = [
        "pretrain",
        "study.toml",
        "--set=pretrain.period={ start = 2022-11-01, end = 2022-11-02 }",
        "--set=model.period={ start = 2022-11-01T18:00:00, end = 2022-11-03 }",
    ];
    assert_snapshot!("overlapping_periods", place.calib(&overlap).fails(2));
    place.calib(&["build-model", "study.toml"]).succeeds();
    assert_snapshot!("no_agents", sweep(&[]));
    place.calib(&["pretrain", "study.toml"]).succeeds();
    assert_snapshot!("another_gamma", sweep(&["agent.gamma=0.5"]));
    assert_snapshot!("another_sensor", sweep(&["sweep.sensors=[\"TUIT101\"]"]));
    let taken = "pretrain={ checkpoint = \"study-results/pretrain\", fraction = 0.4 }";
    assert_snapshot!("another_shape", sweep(&[taken, "agent.value_function=mlp"]));
    let sensor = sweep(&[taken, "sweep.sensors=[\"TUIT101\"]"]);
    assert!(sensor.contains("it has PIT300, TIT101; pre-train there, or correct"), "{sensor}");
    place
        .calib(&["build-model", "study.toml", "--set", "preprocess.normalise=standard"])
        .succeeds();
    let columns = sweep(&[taken, "preprocess.normalise=standard"]);
    assert!(columns.contains("was normalised otherwise"), "{columns}");
    place.calib(&["build-model", "study.toml"]).succeeds();
    let weights = place.path().join("study-results/pretrain/PIT300.safetensors");
    fs::write(&weights, b"damaged").expect("writable");
    assert!(sweep(&[]).contains("run `calib pretrain study.toml` to make it again"));
    let damaged = sweep(&[taken]);
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
    let pretrained = |output: &str, set: &str| {
        place.calib(&["pretrain", "study.toml", "--output", output, "--set", set]).succeeds();
        place.content(&format!("{output}/pretrain"))
    };
    let near = pretrained("near", "agent.gamma=0.9");
    let far = pretrained("far", "agent.gamma=0.8");
    let set = "agent.gammas={ TIT101 = 0.8 }";
    let both = pretrained("both", set);
    for (name, alone) in [("PIT300.safetensors", &near), ("TIT101.safetensors", &far)] {
        let file = Path::new(name);
        assert!(both[file] == alone[file], "{name}");
        assert!(near[file] != far[file], "{name}");
    }
    place.calib(&["run", "study.toml", "--output", "both", "--set", set]).ends(&[0, 1]);
}
