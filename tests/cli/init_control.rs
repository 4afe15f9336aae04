//! `calib init` for agents that act, and numbers of such agents that do not fit a log.

use crate::control;

/// Temperatures and initial weights are in units of return.
#[test]
fn numbers_beyond_the_returns_of_the_log_are_told() {
    let place = control::place();
    let dry = ["control", "pole/study.toml", "--dry-run"];
    let told = |set: &[&str]| place.calib(&[&dry[..], set].concat()).stderr();
    let large = told(&["--set=control.agent.temperature=100000"]);
    assert!(large.contains("temperature 100000 is more than the spread"), "{large}");
    assert!(large.contains("set control.agent.temperature to "), "{large}");
    let swept = told(&["--set=control.grid={ temperature = [1.0, 100000.0] }"]);
    assert!(!swept.contains("is more than the spread"), "one of them fits: {swept}");
    let swept = told(&["--set=control.grid={ initial_weight = [1e6, 2e6] }"]);
    assert!(swept.contains("initial weights of 1000000 are more than"), "{swept}");
    assert!(swept.contains("set control.grid.initial_weight to 0"), "{swept}");
}
