//! Trials of agents: other horizons where none is ahead, and the size of the study that follows.

use std::fmt::Write as _;

use crate::harness::Place;

/// Returns random numbers from 0 to 1, always the same ones.
fn noise() -> impl Iterator<Item = f64> {
    let states = std::iter::successors(Some(1_u32), |state| {
        Some(state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223))
    });
    states.skip(1).map(|state| f64::from(state >> 16) / 65_536.0)
}

/// Returns a log with one row per minute of an oscillation that never repeats: the logistic map, with noise. A network
/// predicts it a few minutes ahead, and no linear predictor does.
fn oscillation() -> String {
    let mut text = String::from("time,A\n");
    let mut value = 0.3;
    for (row, rough) in noise().take(12_000).enumerate() {
        value = 3.9 * value * (1.0 - value);
        let time = 1_710_288_000 + 60 * row;
        writeln!(text, "{time},{:.4}", value + 0.05 * (rough - 0.5)).expect("memory");
    }
    text
}

/// Returns a log with one row per minute of two sensors that are noise.
fn white_noise() -> String {
    let mut text = String::from("time,A,B\n");
    let mut noise = noise();
    for row in 0..4_000 {
        let time = 1_710_288_000 + 60 * row;
        let [one, other] = [noise.next(), noise.next()].map(|number| number.expect("no end"));
        writeln!(text, "{time},{one:.4},{other:.4}").expect("memory");
    }
    text
}

#[test]
fn a_shorter_horizon_is_named_if_an_agent_is_ahead_there() {
    let place = Place::new();
    place.write("log.csv", &oscillation());
    let told = place.calib(&["init", "log.csv", "--within", "2m", "--horizon", "20m"]).succeeds();
    let line = told.lines().find(|line| line.contains("tried for")).expect(&told);
    assert!(line.starts_with("At a horizon of 10 min a network has 0."), "{line}");
    assert!(line.contains(" of the error of an autoregression for A: `"), "{line}");
    // What was asked for stays.
    assert!(place.read("study.toml").contains("gamma = 0.95 "), "{}", place.read("study.toml"));
    let command = line.split('`').nth(1).expect(line);
    assert_eq!(command, "calib init log.csv study.toml --within 2m --horizon 10m --force");
    let words: Vec<&str> = command.split(' ').skip(1).collect();
    let told = place.calib(&words).succeeds();
    assert!(told.contains("A predicted 10 min ahead"), "{told}");
    assert!(!told.contains("tried for") && !told.contains("no agent is shown"), "{told}");
}

#[test]
fn what_was_tried_is_named_if_no_agent_is_ahead_anywhere() {
    let place = Place::new();
    place.write("log.csv", &white_noise());
    let init = ["init", "log.csv", "--within=2m", "--horizon=10m", "--sensor=A"];
    let init = place.calib(&init);
    let told = init.succeeds();
    let tried = "no agent is shown to do better with a horizon of 5 min";
    assert!(told.contains(tried), "{told}");
    assert!(!told.contains("At a horizon"), "{told}");
    let warned = init.stderr();
    assert!(warned.contains("nothing that calib tried predicts 10 min ahead"), "{warned}");
    let study = place.read("study.toml");
    assert!(study.contains("gamma = 0.9 ") && study.contains("sensors = [\"A\"]"), "{study}");
}

/// A sensor misses a tenth of the held-out period, so fewer windows fit than its rows allow.
#[test]
fn windows_are_counted_without_rows_that_lack_values() {
    let place = Place::new();
    let rows = super::log_of(4_000);
    let rows: Vec<String> = rows
        .lines()
        .enumerate()
        .map(|(line, text)| {
            let cells: Vec<&str> = text.split(';').collect();
            // Two lines come before the rows.
            let level = if (3_302..3_422).contains(&line) { "" } else { cells[2] };
            format!("{};{};{level};{}", cells[0], cells[1], cells[3..].join(";"))
        })
        .collect();
    place.write("log.csv", &(rows.join("\n") + "\n"));
    place.calib(&["init", "log.csv", "--within=10s", "--horizon=8m"]).succeeds();
    let study = place.read("study.toml");
    assert!(study.contains("4 windows fit beside each other"), "{study}");
    place.calib(&["run", "study.toml", "-q"]).ends(&[0, 1]);
    let sweep = place.read_json("study-results/sweep/manifest.json");
    assert_eq!(sweep["windows"].as_array().map(Vec::len), Some(4), "{study}");
}
