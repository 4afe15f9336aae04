//! Tests against reference values of dtw-python 1.9.0, made by `scripts/golden/dtw.py`.

use calib_dtw::{Dtw, DtwError, InstructionSet, Settings, StepPattern};
use serde_json::Value;

fn numbers(value: &Value) -> Vec<f64> {
    let list = value.as_array().expect("a list");
    list.iter().map(|number| number.as_f64().expect("a number")).collect()
}

fn close(ours: f64, theirs: f64) -> bool {
    (ours - theirs).abs() <= 1e-9 * theirs.abs().max(1e-12)
}

/// Checks each result of each case. `check` receives the settings, the query, the reference, and the
/// package's result.
fn check_each(golden: &str, mut check: impl FnMut(Dtw, &[f64], &[f64], &Value)) {
    let golden: Value = serde_json::from_str(golden).expect("JSON");
    for case in golden["cases"].as_array().expect("a list") {
        let query = numbers(&case["query"]);
        let reference = numbers(&case["reference"]);
        for result in case["results"].as_array().expect("a list") {
            let [pattern, window, ends] =
                [0, 1, 2].map(|number: usize| result[number].as_str().expect("text"));
            let settings = Settings {
                window: window.parse().expect("its name"),
                ends: ends.parse().expect("its name"),
                ..Settings::default()
            };
            let pattern: StepPattern = pattern.parse().expect("its name");
            check(Dtw::with_settings(pattern, settings), &query, &reference, result);
        }
    }
}

#[test]
fn distances_agree_with_the_reference_package() {
    let mut compared = 0;
    let golden = include_str!("../golden/distances.json");
    check_each(golden, |dtw, query, reference, result| {
        for set in InstructionSet::available() {
            let dtw = dtw.clone().instruction_set(set).unwrap();
            let ours = dtw.distance(query, reference);
            let what = format!("{result} by {set}: {ours:?}");
            compared += 1;
            let Some(raw) = result[3].as_f64() else {
                assert!(ours.is_err(), "{what}");
                continue;
            };
            let ours = ours.expect(&what);
            assert!(close(ours.raw, raw), "{what}");
            match result[4].as_f64() {
                Some(normalised) => {
                    assert!(close(ours.normalised.expect(&what), normalised), "{what}");
                }
                None => assert_eq!(ours.normalised, None, "{what}"),
            }
        }
    });
    assert!(compared >= 351, "{compared}");
}

#[test]
fn paths_agree_with_the_reference_package() {
    let mut paths = 0;
    let mut impossible = 0;
    let golden = include_str!("../golden/paths.json");
    check_each(golden, |dtw, query, reference, result| {
        let ours = dtw.align(query, reference);
        let what = format!("{result}: {ours:?}");
        let Some(raw) = result[3].as_f64() else {
            assert!(matches!(ours, Err(DtwError::NoPath(_))), "{what}");
            impossible += 1;
            return;
        };
        let ours = ours.expect(&what);
        assert!(close(ours.distance.raw, raw), "{what}");
        let theirs = numbers(&result[5]).into_iter().zip(numbers(&result[6]));
        let theirs: Vec<_> = theirs.map(|(i, j)| (i as usize, j as usize)).collect();
        assert_eq!(ours.path, theirs, "{what}");
        paths += 1;
    });
    assert_eq!((paths, impossible), (98, 5));
}
