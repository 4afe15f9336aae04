use std::slice::from_ref;

use super::*;

fn changes(value: impl Fn(usize) -> f64) -> Changes {
    let values: Vec<f64> = (0..2_000).map(value).collect();
    Changes::of(&values, from_ref(&(0..2_000)), Moments::of(&values))
}

fn turn_of(value: impl Fn(usize) -> f64) -> Option<f64> {
    changes(value).wraps
}

fn wander(row: usize) -> f64 {
    300.0 + 90.0 * (row as f64 / 40.0).sin() + 7.0 * (row as f64 * 1.3).sin()
}

/// A pump that is off or at full speed.
fn pump(row: usize) -> f64 {
    if (row / 50).is_multiple_of(2) { 0.0 } else { 345.0 + (row % 5) as f64 }
}

#[test]
fn angles_and_totals_that_start_anew_are_told() {
    assert!(
        changes(|row| (wander(row) + 3.0 * row as f64 / 10.0).rem_euclid(360.0)).wraps
            == Some(360.0)
    );
    assert!(
        changes(|row| (row as f64 / 30.0 + (row as f64).sin())
            .sin()
            .atan2((row as f64 / 30.0).cos()))
        .wraps
            == Some(std::f64::consts::TAU)
    );
    assert_eq!(turn_of(|row| (row % 360) as f64 - 180.0), Some(360.0), "a shaft");
    assert_eq!(turn_of(|row| 180.0 + 180.0 * (row as f64 / 40.0).sin()), None, "a valve");
    assert_eq!(turn_of(|row| ((row * 7_919 + row * row * 104_729) % 360) as f64), None, "noise");
    assert_eq!(turn_of(pump), None, "a pump that is off or at full speed");
    assert_eq!(turn_of(|row| [0.0, 6.25][row / 50 % 2]), None, "a flow of two levels");
    assert!(changes(|row| (row % 144) as f64 + (row % 7) as f64 / 10.0).restarts);
    assert!(!changes(|row| (row as f64 / 9.0).sin()).restarts);
}

#[test]
fn autocorrelation_of_a_wave_is_its_cosine() {
    let turn = std::f64::consts::TAU / 40.0;
    let wave: Vec<f64> = (0..4_000).map(|row| (f64::from(row) * turn).sin()).collect();
    let found = autocorrelation(&wave, from_ref(&(0..4_000)), 0.5);
    for (lag, value) in found.into_iter().filter(|(lag, _)| *lag <= 100) {
        let expected = (lag as f64 * turn).cos();
        assert!((value - expected).abs() < 0.01, "{lag}: {value} and {expected}");
    }
}

#[test]
fn gaps_and_missing_values_do_not_count() {
    let mut values: Vec<f64> = (0..200).map(f64::from).collect();
    values[50] = f64::NAN;
    let found = autocorrelation(&values, &[0..100, 100..200], 1.0);
    // For a slope of one, the mean square at a lag is the square of the lag.
    assert_eq!(found[0], (1, 0.5));
    assert_eq!(found[1], (2, -1.0));
    assert!(found.iter().all(|(lag, _)| *lag < 100), "no pair spans both stretches");
}

/// Returns the run of missing values in stretches of a hundred rows that have values only in
/// `there`.
fn run_between(there: &[Range<usize>]) -> usize {
    let rows: Vec<usize> = there.iter().flat_map(Range::clone).collect();
    missing_run(rows.into_iter().map(|row| (row / 100, row)))
}

#[test]
fn runs_of_missing_values_are_between_values() {
    assert_eq!(run_between(&[3..10, 14..95]), 4);
    assert_eq!(run_between(&[20..90, 110..120]), 0, "a gap is no run");
    assert_eq!(run_between(&[]), 0);
}

/// Returns the changes of values in one stretch.
fn changes_of(values: &[f64]) -> Changes {
    Changes::of(values, from_ref(&(0..values.len())), Moments::of(values))
}

#[test]
fn totals_only_rise_and_clocks_rise_evenly() {
    let clock: Vec<f64> = (0..100).map(f64::from).collect();
    let clock = changes_of(&clock);
    assert_eq!((clock.rises, clock.even), (1.0, 1.0));
    let total: Vec<f64> = (0..100).map(|row| f64::from(row * row)).collect();
    let total = changes_of(&total);
    assert!(total.rises == 1.0 && total.even < 0.1);
    let wave: Vec<f64> = (0..400).map(|row| (f64::from(row) / 10.0).sin()).collect();
    assert!((changes_of(&wave).rises - 0.5).abs() < 0.1);
}

fn counts(value: impl Fn(f64) -> f64) -> bool {
    let values: Vec<f64> = (0..2_000).map(|row| value(f64::from(row))).collect();
    counts_on_evenly(&values)
}

#[test]
fn numbers_of_rows_steps_and_episodes_count_on_evenly() {
    assert!(counts(|row| row));
    assert!(counts(|row| row % 50.0), "steps of episodes");
    assert!(counts(|row| (row / 50.0).floor()), "episodes");
    assert!(!counts(|row| (row / 500.0).floor()), "four values");
    assert!(!counts(f64::sin));
    assert!(!counts(|row| f64::NAN * row));
}
