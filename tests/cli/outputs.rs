//! Complete outputs of commands, as snapshots for a reviewer.

use crate::harness::{Place, Ran};

/// Returns both streams, without times, sizes and the number of threads.
fn shown(ran: &Ran) -> String {
    format!("{}--- stderr\n{}--- exit code {}", ran.stdout(), ran.stderr(), ran.code())
}

fn with_filters(check: impl FnOnce()) {
    let mut settings = insta::Settings::clone_current();
    settings.add_filter(r"\b\d[\d.,]* (B|KiB|MiB|GiB)\b", "[size]");
    settings.add_filter(r"(?m)\b(in|took|for|done in) \d[\d.]* (ms|s|min)( \d+ s)?$", "$1 [time]");
    settings.add_filter(r"\bon \d+ threads?\b", "on [n] threads");
    settings.add_filter(r"\(\d+ threads?\)", "([n] threads)");
    settings.add_filter(r"[ \t]+\n", "\n");
    settings.bind(check);
}

#[test]
fn a_study_from_its_log_to_the_verdict() {
    let place = Place::with_study();
    let run = place.calib(&["run", "study.toml"]);
    let again = place.calib(&["run", "study.toml"]);
    let evaluate = place.calib(&["evaluate", "study.toml", "--why"]);
    let explained = place.calib(&["run", "study.toml", "--why"]);
    assert_eq!(explained.stdout(), evaluate.stdout());
    let inspect = place.calib(&["inspect", "study.toml"]);
    with_filters(|| {
        insta::assert_snapshot!("run", shown(&run));
        insta::assert_snapshot!("run_again", shown(&again));
        insta::assert_snapshot!("evaluate_why", shown(&evaluate));
        insta::assert_snapshot!("inspect", shown(&inspect));
    });
}

#[test]
fn agents_that_act() {
    let place = Place::new();
    let args = ["simulate", "pole", "--task", "cart-pole", "--policy", "random"];
    place.calib(&[&args[..], &["--transitions", "1000"]].concat()).succeeds();
    let quick = ["--set", "control.steps=1000", "--set", "control.model.members=3"];
    let grid = ["--set", "control.grid={ step_size = [0.03, 0.3] }"];
    let control = place.calib(&[&["control", "pole/study.toml"], &quick[..], &grid[..]].concat());
    with_filters(|| insta::assert_snapshot!("control", shown(&control)));
}
