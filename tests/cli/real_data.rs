//! The studies of real plants, much shortened. They need `CALIB_DATA`, and are skipped without it.

use std::path::Path;

use crate::harness::Place;

#[expect(clippy::print_stderr, reason = "a test that skips says so")]
fn run_shortened(study: &str, folder: &str, more: &[&str]) {
    let Some(data) = std::env::var_os("CALIB_DATA") else {
        eprintln!("skipped: CALIB_DATA is not set, so {folder} is not at hand");
        return;
    };
    let place = Place::new();
    let study = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs").join(study);
    let mut set = vec![
        "agent.value_function=linear",
        "agent.batch_size=16",
        "agent.gamma=0.9",
        "sweep.steps=1500",
        "sweep.online_runs=2",
        "sweep.member_runs=1",
        "sweep.log_replay_runs=1",
        "rollout.steps=500",
        "rollout.rollouts=1",
    ];
    set.extend(more);
    for command in ["build-model", "rollout", "sweep", "evaluate"] {
        let mut calib = place.command(&[command]);
        calib.arg(&study).args(["--output", "results"]).env("CALIB_DATA", &data);
        for text in &set {
            calib.args(["--set", text]);
        }
        let output = calib.output().expect("calib runs");
        let told = String::from_utf8_lossy(&output.stderr);
        assert!(matches!(output.status.code(), Some(0 | 1)), "{command}: {told}");
        if command == "evaluate" {
            let verdict = String::from_utf8_lossy(&output.stdout);
            let (predicts, sensors) = verdict.split_once('\n').expect("lines");
            assert!(predicts.starts_with("Agents predict the mean of their sensor"), "{verdict}");
            let headlines = sensors.lines().filter(|line| is_headline(line));
            assert_eq!(headlines.count(), 3, "{verdict}");
        }
    }
    assert!(place.path().join("results/report.html").is_file());
}

/// Whether a line of a verdict names the choice for a sensor.
fn is_headline(line: &str) -> bool {
    ![" ", "note: ", "report: "].iter().any(|start| line.starts_with(start))
}

#[test]
fn the_membrane_bioreactor_gets_a_verdict() {
    run_shortened("mbr.toml", "mbr-mines", &["preprocess.subsample=4"]);
}

#[test]
fn the_oil_wells_get_a_verdict() {
    run_shortened("wells.toml", "3w-field-2017-08", &["preprocess.subsample=40"]);
}

/// Checks the tables of all states at 1 Hz, raw (12 columns) and with traces (144), against brute force in
/// f64, bit by bit.
#[test]
fn neighbours_on_the_oil_wells_agree_with_brute_force() {
    let Some(data) = std::env::var_os("CALIB_DATA") else {
        eprintln!("skipped: CALIB_DATA is not set, so 3w-field-2017-08 is not at hand");
        return;
    };
    let decays: Vec<String> =
        (1..12).map(|power| (1.0 - 0.5_f64.powi(power)).to_string()).collect();
    let traces = format!("preprocess.traces=[{}]", decays.join(","));
    let study = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/wells.toml");
    for (traces, columns) in [("preprocess.traces=[]", 12), (&traces, 144)] {
        let place = Place::new();
        let mut calib = place.command(&["build-model"]);
        calib.arg(&study).args(["--output", "results", "--verify", "6"]).env("CALIB_DATA", &data);
        calib.args(["--set", "preprocess.subsample=1", "--set", traces]);
        let output = calib.output().expect("calib runs");
        let told = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{told}");
        assert!(told.contains(&format!("rows x {columns} columns")), "{told}");
        assert!(told.contains("verified: 30 rows agree with brute force"), "{told}");
    }
}
