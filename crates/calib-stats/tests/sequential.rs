//! The sequential test: boundaries made by `scripts/golden/sequential.py`, and how often simulated races end.

mod random;

use calib_stats::{Look, SequentialTest, StatsError};
use random::Random;
use serde::Deserialize;

const INF: f64 = f64::INFINITY;

#[derive(Deserialize)]
struct Case {
    most: usize,
    error_rate: f64,
    boundaries: Vec<f64>,
}

#[test]
fn boundaries_agree_with_another_integration() {
    let cases: Vec<Case> = serde_json::from_str(include_str!("sequential.json")).expect("cases");
    assert_eq!(cases.len(), 5);
    for Case { most, error_rate, boundaries } in cases {
        let test = SequentialTest::new(most, error_rate).unwrap();
        for (n, expected) in (3..=most).zip(boundaries) {
            let got = test.boundary(n).expect("a look");
            assert!((got / expected - 1.0).abs() < 2e-4, "{most} {n}: {got}, not {expected}");
        }
        assert_eq!((test.boundary(2), test.boundary(most + 1)), (None, None));
    }
}

/// The share of `races` that end with the candidate called worse, and the mean number of observations.
fn raced(
    test: &SequentialTest,
    most: usize,
    races: usize,
    mut draw: impl FnMut() -> f64,
) -> (f64, f64) {
    let mut ended = 0;
    let mut observations = 0;
    for _ in 0..races {
        let mut differences = Vec::with_capacity(most);
        while differences.len() < most {
            differences.push(draw());
            if test.look(&differences) == Ok(Look::Worse) {
                ended += 1;
                break;
            }
        }
        observations += differences.len();
    }
    (f64::from(ended) / races as f64, observations as f64 / races as f64)
}

#[test]
fn without_a_difference_a_race_ends_as_often_as_it_may() {
    // Four standard errors of a share of 0.05 in 40,000 races are 0.0044, of 0.0063 0.0016.
    let mut random = Random::new(7);
    for (most, error_rate, tolerance) in
        [(5, 0.05, 0.0044), (10, 0.05 / 8.0, 0.0016), (15, 0.05, 0.0044)]
    {
        let test = SequentialTest::new(most, error_rate).unwrap();
        let (wrong, _) = raced(&test, most, 40_000, || 3.0 * random.normal());
        assert!((wrong - error_rate).abs() < tolerance, "{most}: {wrong}, not {error_rate}");
        let (better, _) = raced(&test, most, 10_000, || random.normal() - 1.0);
        assert!(better < error_rate / 10.0, "a better candidate: {better}");
    }
}

#[test]
fn differences_that_are_not_normal_change_the_error_rate_little_unless_they_are_skewed() {
    let test = SequentialTest::new(15, 0.05).unwrap();
    let mut random = Random::new(8);
    let heavy = || {
        let squares: f64 = (0..5).map(|_| random.normal().powi(2)).sum();
        random.normal() / (squares / 5.0).sqrt()
    };
    let (heavy, _) = raced(&test, 15, 40_000, heavy);
    assert!((heavy - 0.043).abs() < 0.004, "{heavy}");
    // exp(σ z) − exp(σ² / 2) has mean 0; its skewness is 0.8 for σ = 0.25 and 1.75 for 0.5.
    let mut skewed = |width: f64, sign: f64| {
        let mean = (width * width / 2.0).exp();
        raced(&test, 15, 40_000, || sign * ((width * random.normal()).exp() - mean)).0
    };
    let [little, much] = [0.25, 0.5].map(|width| [skewed(width, 1.0), skewed(width, -1.0)]);
    let near = |got: f64, expected: f64| {
        assert!((got - expected).abs() < 0.006, "{got}, not {expected}: {little:?} {much:?}");
    };
    near(little[0], 0.025);
    near(little[1], 0.091);
    near(much[0], 0.012);
    near(much[1], 0.151);
}

#[test]
fn real_differences_are_found_early() {
    let mut random = Random::new(9);
    let test = SequentialTest::new(10, 0.05 / 8.0).unwrap();
    let mut of = |effect: f64| raced(&test, 10, 10_000, || random.normal() + effect);
    let one = of(1.0);
    let two = of(2.0);
    let four = of(4.0);
    assert!((one.0 - 0.35).abs() < 0.02 && (one.1 - 9.25).abs() < 0.1, "{one:?}");
    assert!((two.0 - 0.965).abs() < 0.01 && (two.1 - 6.88).abs() < 0.1, "{two:?}");
    assert!(four.0 > 0.999 && (four.1 - 4.66).abs() < 0.1, "{four:?}");
}

#[test]
fn divergence_and_equal_differences_are_decided() {
    let test = SequentialTest::new(5, 0.05).unwrap();
    let look = |differences: &[f64]| test.look(differences);
    assert_eq!(look(&[]), Ok(Look::Open));
    assert_eq!(look(&[9.0, 9.0]), Ok(Look::Open), "two tell nothing");
    assert_eq!(look(&[9.0, 9.0, 9.0]), Ok(Look::Worse), "t is infinite");
    assert_eq!(look(&[0.0; 3]), Ok(Look::Open));
    assert_eq!(look(&[-9.0; 3]), Ok(Look::Open));
    assert_eq!(look(&[-5.0, INF]), Ok(Look::Worse), "the candidate diverged");
    assert_eq!(look(&[9.0, 9.0, -INF]), Ok(Look::Open), "the leader did");
    assert_eq!(look(&[9.0; 6]), Ok(Look::Open), "after the last look");
    assert_eq!(look(&[INF, -INF]), Err(StatsError::OpposedInfinities { what: "differences" }));
    assert!(look(&[f64::NAN]).is_err());
}

#[test]
fn races_that_cannot_be_are_refused() {
    for most in [0, 2, 201] {
        assert!(matches!(SequentialTest::new(most, 0.05), Err(StatsError::Race { .. })), "{most}");
    }
    for error_rate in [0.0, 0.6, -1.0, f64::NAN] {
        let refused = SequentialTest::new(9, error_rate);
        assert!(matches!(refused, Err(StatsError::Race { .. })), "{error_rate}");
    }
    let text = serde_json::to_string(&SequentialTest::new(4, 0.05).unwrap()).expect("written");
    assert_eq!(
        serde_json::from_str::<SequentialTest>(&text).expect("read"),
        SequentialTest::new(4, 0.05).unwrap()
    );
}
