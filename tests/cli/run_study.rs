//! From logs to a verdict, with the same bytes every time.

use crate::harness::{Place, assert_same};

#[test]
fn the_chain_ends_with_a_verdict_and_a_report() {
    let place = Place::with_study();
    place.calib(&["inspect", "study.toml"]).succeeds_with(&["PIT300", "transitions"]);
    let built = place.calib(&["build-model", "study.toml", "--verify", "50"]);
    assert!(built.succeeds().contains("member 2"));
    assert!(built.stderr().contains("verified: 150 rows agree"), "{}", built.stderr());
    place.run_steps(&["rollout", "sweep"]);
    place.calib(&["evaluate", "study.toml"]).succeeds_with(&["PIT300", "TIT101", "held-out data"]);
    for file in [
        "model/manifest.json",
        "model/states.npy",
        "model/rows.parquet",
        "model/members/2/neighbors.npy",
        "rollout/trajectories.parquet",
        "rollout/figures/PIT300.svg",
        "sweep/runs.parquet",
        "sweep/curves.parquet",
        "evaluate/summary.json",
        "sweep/recorded.parquet",
        "evaluate/figures/sensitivity-PIT300.png",
        "evaluate/figures/recorded-PIT300.svg",
        "evaluate/figures/recorded-PIT300.png",
        "report.html",
    ] {
        assert!(place.path().join("study-results").join(file).is_file(), "{file} is missing");
    }
    let summary = place.calib(&["evaluate", "study.toml", "--json", "-q"]).json(&[0]);
    assert_eq!(summary["verdicts"].as_array().expect("a list").len(), 2);
}

#[test]
fn results_are_the_same_bytes_for_any_number_of_threads() {
    let place = Place::with_study();
    for (threads, output) in [("1", "one"), ("4", "four")] {
        for command in ["build-model", "rollout", "sweep", "evaluate"] {
            place
                .calib(&[command, "study.toml", "--output", output, "--threads", threads])
                .succeeds();
        }
    }
    assert_same(&place.content("one"), &place.content("four"));
}

#[test]
fn a_dry_run_refuses_a_sensor_that_the_log_does_not_have() {
    let place = Place::with_study();
    let wrong = ["run", "study.toml", "--dry-run", "--set", "sweep.sensors=[\"PIT30\"]"];
    let told = place.calib(&wrong).fails(2);
    assert!(told.contains("\"PIT30\" is not a channel of the log"), "{told}");
    assert!(!told.contains("waits for the steps before it"), "{told}");
}

/// Asserts that a dry run tells which step waits for a file.
fn assert_waits(place: &Place, step: &str, reason: &str) {
    let dry = place.on_study("run", &["--dry-run"]);
    dry.succeeds();
    let line = format!("dry run: {step} waits for the steps before it (study-results/{reason}");
    assert!(dry.stderr().contains(&line), "{}", dry.stderr());
}

#[test]
fn a_dry_run_refuses_start_states_and_agents_that_are_not_there() {
    let place = Place::with_study();
    let rows = "rollout.rows=[99999999]";
    let wrong: [(&[&str], &str); 5] = [
        (
            &["rollout.start=rows", rows],
            "start row 99999999 does not exist: the data has rows 0 to",
        ),
        (
            &["rollout.start=rows", "sweep.start=random", rows],
            "start row 99999999 does not exist: the data has rows 0 to",
        ),
        (&["sweep.start=rows", rows], "start row 99999999 does not exist: the data has rows 0 to"),
        (
            &["rollout.start=calendar_month", "rollout.month=3"],
            "no rows in month 3 of a year before 2022",
        ),
        (
            &["pretrain={ checkpoint = \"nowhere\", fraction = 0.4 }"],
            "nowhere/manifest.json does not exist; pre-train there, or correct pretrain.checkpoint",
        ),
    ];
    for is_built in [false, true] {
        if is_built {
            place.calib(&["build-model", "study.toml"]).succeeds();
        } else {
            assert_waits(&place, "rollout", "model/manifest.json does not exist");
        }
        for (set, expected) in wrong {
            let set: Vec<&str> = set.iter().flat_map(|set| ["--set", set]).collect();
            let told = place.on_study("run", &[&["--dry-run"], &set[..]].concat()).fails(2);
            assert!(told.contains(expected), "{set:?}: {told}");
            assert!(!told.contains("calib pretrain"), "{set:?}: {told}");
        }
        assert_waits(&place, "evaluate", "sweep/manifest.json does not exist");
    }
}

#[test]
fn what_is_up_to_date_is_not_made_again() {
    let place = Place::with_study();
    for (command, made) in
        [("build-model", "wrote"), ("rollout", "wrote"), ("sweep", "training runs made")]
    {
        place.on_study(command, &[]).succeeds_with(&[made]);
        place.on_study(command, &[]).succeeds_with(&["up to date"]);
    }
    let before = place.content("study-results");
    for command in ["build-model", "rollout", "sweep"] {
        place.calib(&[command, "study.toml", "--force"]).succeeds();
    }
    assert!(place.content("study-results") == before, "made again, it is the same");

    // Other steps need another sweep, and so do other start states and weights. The model stays.
    // Each of 22 runs trains three settings; 12 of them are in the model.
    for (set, left) in [
        ("sweep.steps=700", "all 66 training runs are left"),
        ("sweep.scored=final_quarter", "0 of 66 training runs are left"),
        ("rollout.start=recent", "36 of 66 training runs are left"),
        ("evaluate.top_k=1", "0 of 66 training runs are left"),
    ] {
        let told = place.on_study("sweep", &["--dry-run", "--set", set]).stderr();
        assert!(told.contains(left), "{set}: {told}");
    }

    // One more value: only the changed grid is run, and the model stays.
    place.edit_study("[1e-5, 1e-3, 1e-2]", "[1e-5, 1e-4, 1e-3, 1e-2]");
    place.on_study("build-model", &[]).succeeds_with(&["up to date"]);
    place.on_study("sweep", &[]).succeeds_with(&["training runs made"]);
    place.run_steps(&["evaluate"]);
}

#[test]
fn deleted_results_are_made_again() {
    let place = Place::with_study();
    let files = [
        ("build-model", "model/rows.parquet"),
        ("rollout", "rollout/trajectories.parquet"),
        ("rollout", "rollout/dtw.parquet"),
        ("rollout", "rollout/one_step.parquet"),
        ("sweep", "sweep/runs.parquet"),
    ];
    for (command, file) in files {
        place.calib(&[command, "study.toml"]).succeeds();
        let path = place.path().join("study-results").join(file);
        let before = std::fs::read(&path).expect("readable");
        std::fs::remove_file(&path).expect("there");
        place.calib(&[command, "study.toml"]).succeeds();
        assert!(std::fs::read(&path).expect("made again") == before, "{file}");
    }
}

#[test]
fn a_study_runs_from_anywhere() {
    let place = Place::with_study();
    place.run_steps(&["build-model", "sweep"]);
    let path = place.path().join("study.toml");
    let mut elsewhere = place.command(&["evaluate"]);
    let output = elsewhere.arg(&path).current_dir("/").output().expect("calib runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn a_dry_run_writes_nothing() {
    let place = Place::with_study();
    place.calib(&["build-model", "study.toml", "--dry-run"]).succeeds();
    assert!(!place.path().join("study-results").exists());
    place.calib(&["build-model", "study.toml"]).succeeds();
    place.calib(&["sweep", "study.toml", "--dry-run"]).succeeds();
    assert!(!place.path().join("study-results/sweep").exists());
}

#[test]
fn a_dry_run_says_how_long_each_step_takes_and_all_together() {
    let place = Place::with_study();
    place.extend_study(
        "[pretrain]\nepochs = 2\nfraction = 0.4\n\
         [models.laplacian.representation]\nkind = \"laplacian\"\ndimension = 4\nhidden_units = 16\nsteps = 200\n\
         [models.network]\nmodel.kind = \"nn\"\ndynamics = { hidden_units = 16, epochs = 2 }\n",
    );
    let dry = place.calib(&["run", "study.toml", "--dry-run"]);
    dry.succeeds();
    let told = dry.stderr();
    let steps: Vec<&str> = told.split("\n[").skip(1).collect();
    // Pre-training, the representation, two models, their rollouts and sweeps, the verdict.
    assert_eq!(steps.len(), 9, "{told}");
    for step in steps {
        let is_timed = step.contains("expecting about ");
        assert_eq!(is_timed, !step.contains("] evaluate"), "{step}");
    }
    let mut lines = told.lines();
    let all = lines.find(|line| line.contains("In all: about ")).expect(&told);
    for part in [" of a processor on this machine, up to ", " of memory, up to "] {
        assert!(all.contains(part), "{all}");
    }
    assert!(all.ends_with(" on disk; without the time of reading the log, evaluate"), "{all}");
    let plan = place.calib(&["run", "study.toml", "--dry-run", "--json", "-q"]).json(&[0]);
    for step in plan["steps"].as_array().expect("steps") {
        let secs = step["cost"]["processor_secs"].as_f64();
        let is_timed =
            !["reading the log", "evaluate"].contains(&step["step"].as_str().expect("a name"));
        assert_eq!(secs.is_some_and(|secs| secs > 0.0), is_timed, "{step}");
    }
    assert!(!place.path().join("study-results").exists(), "nothing is written");
}

#[test]
fn what_is_up_to_date_has_no_expected_cost() {
    let place = Place::with_study();
    for command in ["build-model", "rollout"] {
        place.calib(&[command, "study.toml"]).succeeds();
        let dry = place.on_study(command, &["--dry-run"]);
        dry.succeeds();
        assert!(!dry.stderr().contains("expecting about "), "{}", dry.stderr());
    }
    let dry = place.on_study("run", &["--dry-run"]);
    dry.succeeds();
    assert!(dry.stderr().contains("; without the time of evaluate"), "{}", dry.stderr());
}

/// A disk that is almost full.
const FULL: [(&str, &str); 1] = [("CALIB_FAULT", "free:20000")];

/// Asserts that a command is refused because of the free space, in these words.
fn refused_without_room(place: &Place, args: &[&str], parts: &[&str]) {
    let ran = place.calib_with(args, &FULL);
    ran.fails_with(2, &[&[" on disk, and 19.5 KiB are free where "][..], parts].concat());
}

/// 20,000 bytes are free, and the smallest step writes ten times as much.
#[test]
fn work_that_the_disk_has_no_room_for_is_refused_before_it_begins() {
    let place = Place::with_study();
    let days = ["simulate", "more", "--days", "3", "--channels", "12", "--period", "60"];
    refused_without_room(
        &place,
        &days,
        &["the log of the plant may take", "more lies; simulate fewer days"],
    );
    assert!(!place.path().join("more").exists());
    refused_without_room(
        &place,
        &["run", "study.toml"],
        &["what is left of the study may take", "--output"],
    );
    refused_without_room(
        &place,
        &["build-model", "study.toml"],
        &["the model may take", "model lies; choose a folder"],
    );
    let results = place.path().join("study-results");
    assert!(!results.join("model").exists() && !results.join("sweep").exists());
    // A plan writes nothing, and gives the required space.
    place.calib_with(&["build-model", "study.toml", "--dry-run"], &FULL).succeeds();
    place.calib(&["build-model", "study.toml"]).succeeds();
    refused_without_room(
        &place,
        &["sweep", "study.toml"],
        &["the sweep may take", "sweep.curve_points"],
    );
    assert!(!results.join("sweep").exists());
    // Results that are up to date are not made again.
    place.calib_with(&["build-model", "study.toml"], &FULL).succeeds();
    // A file system that does not report its free space reports 0.
    place.calib_with(&["run", "study.toml"], &[("CALIB_FAULT", "free:0")]).ends(&[0, 1]);
    place.calib_with(&["run", "study.toml"], &FULL).ends(&[0, 1]);
}

#[test]
fn any_agent_field_can_be_swept() {
    let place = Place::with_study();
    place.edit_study(
        "learning_rate = [1e-5, 1e-3, 1e-2]",
        "optimiser = [\"adam\", \"sgd\"]\nbatch_size = [16, 32]",
    );
    place.run_steps(&["build-model", "sweep"]);
    let verdict = place.calib(&["evaluate", "study.toml", "--why"]);
    let told = verdict.stdout();
    assert!(told.contains("of 4 settings"), "{told}");
}

#[test]
fn without_a_held_out_range_there_is_a_choice_but_no_regret() {
    let place = Place::with_study();
    place.edit_study("train_fraction = 0.7", "train_fraction = 1.0");
    place.run_steps(&["build-model", "rollout", "sweep"]);
    let verdict = place.calib(&["evaluate", "study.toml", "--why"]).stdout();
    assert!(verdict.contains("No data was held out"), "{verdict}");
}

#[test]
fn completions_and_man_pages_are_generated() {
    let place = Place::new();
    assert!(place.calib(&["completions", "bash"]).succeeds().contains("build-model"));
    place.calib(&["man", "man"]).succeeds();
    assert!(place.path().join("man/calib-build-model.1").is_file());
}
