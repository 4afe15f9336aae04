//! Choices, regrets and their resampling against NumPy; made by `scripts/golden/choosing.py`.

use calib_stats::{
    Drawn, Interval, Nested, Statistics, choose_around_default, choose_by_mean_log,
    geometric_regret, hierarchical,
};
use serde::Deserialize;
use serde_json::Value;

#[derive(Deserialize)]
struct Golden {
    members: Vec<Vec<Vec<Value>>>,
    windows: Vec<Vec<Vec<Value>>>,
    mean_logs: Vec<Value>,
    chosen: usize,
    regrets: Vec<Value>,
    defaults: Vec<DefaultCase>,
    resamples: usize,
    draws: Vec<usize>,
    regret_of_2: [f64; 2],
    regret_of_rule: [f64; 2],
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
    serde_json::from_str(include_str!("choosing.json")).unwrap()
}

/// JSON has no infinities; the script writes them as `"inf"`.
fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::INFINITY)
}

fn numbers(units: &[Vec<Vec<Value>>]) -> Vec<Vec<Vec<f64>>> {
    let run = |run: &Vec<Value>| run.iter().map(number).collect();
    units.iter().map(|runs| runs.iter().map(run).collect()).collect()
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
            let found = got.advantages[candidate].filter(|of| of.mean.is_finite());
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
    for (choice, expected) in golden.regrets.iter().enumerate() {
        let regret = geometric_regret(&windows.whole().means(), |_| choice).unwrap();
        assert_close(regret.expect("windows count").regret, number(expected));
    }
}

#[test]
fn resampled_regrets_and_choices_agree_with_numpy() {
    let golden = golden();
    let [members, windows] =
        [&golden.members, &golden.windows].map(|of| Nested::new(numbers(of)).unwrap());
    let mut draws = golden.draws.iter().copied();
    let draw = |below: usize| draws.next().filter(|drawn| *drawn < below).expect("as many draws");
    let statistic = |drawn: &[Drawn<'_>]| {
        let chosen = choose_by_mean_log(&[drawn[0].runs()])?.chosen;
        let windows = drawn[1].means();
        let regret = |choice: usize| geometric_regret(&windows, |_| choice);
        let of_rule = chosen.map(regret).transpose()?.flatten();
        let numbers = [regret(2)?, of_rule].map(|of| of.map(|of| of.regret)).to_vec();
        Ok(Statistics { numbers, choices: vec![chosen] })
    };
    let told = hierarchical(&[&members, &windows], golden.resamples, draw, statistic).unwrap();
    assert!(draws.next().is_none(), "no draw is left");
    assert_eq!((&told.choices[0].counts, told.choices[0].none), (&golden.counts, 0));
    for (got, [low, high]) in told.numbers.iter().zip([golden.regret_of_2, golden.regret_of_rule]) {
        let Interval { low: got_low, high: got_high } = got.interval.expect("defined");
        assert_close(got_low, low);
        assert_close(got_high, high);
    }
}
