//! Choices, regrets and their resampling against NumPy. The values are made by
//! `scripts/golden/choosing.py`.

use calib_stats::{Drawn, Losses, Nested, choose_around_default, choose_by_mean_log, hierarchical};
use serde::Deserialize;
use serde_json::Value;

#[derive(Deserialize)]
struct Golden {
    members: Vec<Vec<Vec<Value>>>,
    windows: Vec<Vec<Vec<Value>>>,
    mean_logs: Vec<Value>,
    chosen: usize,
    regrets: Vec<Value>,
    bounds: Vec<Option<f64>>,
    quotient: [f64; 3],
    defaults: Vec<DefaultCase>,
    resamples: usize,
    draws: Vec<usize>,
    counts: Vec<usize>,
}

#[derive(Deserialize)]
struct DefaultCase {
    default: usize,
    streams_per_independent: f64,
    chosen: usize,
    advantages: Vec<Option<[f64; 2]>>,
}

#[expect(clippy::unwrap_used, reason = "a broken golden file must fail the test")]
fn golden() -> Golden {
    serde_json::from_str(include_str!("../choosing.json")).unwrap()
}

/// Reads a number. JSON has no infinities; the script writes them as `"inf"`.
fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::INFINITY)
}

fn numbers(units: &[Vec<Vec<Value>>]) -> Vec<Vec<Vec<f64>>> {
    units
        .iter()
        .map(|runs| runs.iter().map(|run| run.iter().map(number).collect()).collect())
        .collect()
}

#[track_caller]
fn assert_close(got: f64, expected: f64) {
    let tolerance = 1e-9 * expected.abs().max(1e-3);
    assert!(
        got == expected || (got - expected).abs() <= tolerance,
        "got {got}, expected {expected}"
    );
}

#[test]
fn choices_by_log_errors_agree_with_numpy() {
    let golden = golden();
    let members = numbers(&golden.members);
    let choice = choose_by_mean_log(&members).unwrap();
    assert_eq!(choice.chosen, Some(golden.chosen));
    for (got, expected) in choice.mean_logs.iter().zip(&golden.mean_logs) {
        assert_close(*got, number(expected));
    }
    let moved = golden.defaults.iter().filter(|case| case.chosen != case.default).count();
    assert!(moved > 0 && moved < golden.defaults.len(), "some stay and some move");
    for case in &golden.defaults {
        let got = choose_around_default(&members, case.default, case.streams_per_independent);
        let got = got.unwrap();
        assert_eq!(got.chosen, case.chosen);
        for (candidate, expected) in case.advantages.iter().enumerate() {
            let found = got.advantages[candidate].filter(|advantage| advantage.mean.is_finite());
            assert_eq!(found.is_some(), expected.is_some(), "candidate {candidate}");
            if let Some((found, [mean, error])) = found.zip(*expected) {
                assert_close(found.mean, mean);
                assert_close(found.standard_error.expect("several streams"), error);
            }
        }
    }
}

#[test]
fn regrets_over_windows_agree_with_numpy() {
    let golden = golden();
    let windows = Nested::new(numbers(&golden.windows)).unwrap();
    let losses = Losses::new(&windows.whole().means()).unwrap();
    assert!(golden.bounds.iter().any(Option::is_some) && golden.bounds.contains(&None));
    for (choice, (expected, bound)) in golden.regrets.iter().zip(&golden.bounds).enumerate() {
        let regret = losses.regret(choice).expect("windows count");
        assert_close(regret.value, number(expected));
        assert_eq!(regret.upper.is_some(), bound.is_some());
        if let Some((got, expected)) = regret.upper.zip(*bound) {
            assert!((got / expected - 1.0).abs() < 1e-7, "{got}, not {expected}");
        }
    }
    let quotient = losses.quotient(2, 0).expect("finite");
    let [value, low, high] = golden.quotient;
    assert_close(quotient.value, value);
    let interval = quotient.interval.expect("finite");
    assert_close(interval.low, low);
    assert_close(interval.high, high);
}

#[test]
fn resampled_choices_agree_with_numpy() {
    let golden = golden();
    let members = Nested::new(numbers(&golden.members)).unwrap();
    let mut draws = golden.draws.iter().copied();
    let told = hierarchical(
        &[&members],
        golden.resamples,
        |below: usize| draws.next().filter(|drawn| *drawn < below).expect("as many draws"),
        |drawn: &[Drawn<'_>]| Ok(choose_by_mean_log(&[drawn[0].runs()])?.chosen),
    )
    .unwrap();
    assert!(draws.next().is_none(), "no draw is left");
    assert_eq!((&told.counts, told.none), (&golden.counts, 0));
}
