//! Trials of agents, and the size of the study that follows.

use crate::harness::Place;

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
