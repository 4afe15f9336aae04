//! How often 95 % intervals hold the truth, in simulations.

mod random;

use calib_stats::{
    Interval, Losses, error_ratio, paired_difference, summarise, summarise_clusters,
};
use random::Random;

const STUDIES: usize = 2000;

/// The share of simulated studies whose interval holds `truth`. Its standard error is 0.5 % near 95 %.
fn coverage(truth: f64, mut interval: impl FnMut() -> Interval) -> f64 {
    let holds = |of: Interval| of.low <= truth && truth <= of.high;
    (0..STUDIES).filter(|_| holds(interval())).count() as f64 / STUDIES as f64
}

/// Distances from 6 start states, 5 members each: starts differ by 1, members of a start by 0.5.
fn distances(random: &mut Random) -> (Vec<usize>, Vec<f64>) {
    let (mut starts, mut distances) = (Vec::new(), Vec::new());
    for start in 0..6 {
        let level = random.normal();
        for _ in 0..5 {
            starts.push(start);
            distances.push(level + 0.5 * random.normal());
        }
    }
    (starts, distances)
}

#[test]
fn intervals_over_start_states_hold_the_mean_where_those_over_rollouts_do_not() {
    let mut random = Random::new(1);
    let clustered = coverage(0.0, || {
        let (starts, distances) = distances(&mut random);
        summarise_clusters(&starts, &distances).unwrap().interval.expect("six starts")
    });
    assert!((clustered - 0.95).abs() < 0.02, "{clustered}");
    let over_rollouts = coverage(0.0, || {
        let (_, distances) = distances(&mut random);
        summarise(&distances).unwrap().interval.expect("thirty rollouts")
    });
    assert!(over_rollouts < 0.7, "{over_rollouts}");
}

#[test]
fn paired_intervals_hold_the_difference() {
    let mut random = Random::new(2);
    let paired = coverage(-0.3, || {
        let (starts, y) = distances(&mut random);
        // Starts are harder or easier for the other model, by half of what they are for both.
        let of_starts: Vec<f64> = (0..6).map(|_| 0.5 * random.normal()).collect();
        let x: Vec<f64> =
            starts.iter().zip(&y).map(|(&start, y)| y - 0.3 + of_starts[start]).collect();
        paired_difference(&starts, &x, &y).unwrap().interval.expect("six starts")
    });
    assert!((paired - 0.95).abs() < 0.02, "{paired}");
}

/// Squared errors that depend on those before: AR(1) with a memory of ten steps.
fn errors(random: &mut Random, steps: usize, scale: f64) -> Vec<f64> {
    let mut error = random.normal();
    let mut next = || {
        error = 0.9 * error + (1.0 - 0.81_f64).sqrt() * random.normal();
        (scale * error).powi(2)
    };
    (0..steps).map(|_| next()).collect()
}

#[test]
fn quotients_of_errors_that_depend_on_each_other_hold_the_truth() {
    let mut random = Random::new(3);
    let coverage = coverage(0.8, || {
        let (x, y) = (errors(&mut random, 2000, 0.8), errors(&mut random, 2000, 1.0));
        error_ratio(&x, &y).unwrap().expect("defined").interval.expect("sixteen stretches")
    });
    assert!((coverage - 0.95).abs() < 0.025, "{coverage}");
}

#[test]
fn intervals_over_windows_hold_the_quotient_however_few_there_are() {
    let mut random = Random::new(4);
    for windows in [2, 3, 8] {
        let coverage = coverage(0.9, || {
            let mut window = || {
                // Windows differ for all candidates alike and for each alone; two runs differ within them.
                let (level, own) = (random.normal(), 0.05 * random.normal());
                let mut mean = |error: f64| {
                    let mut run = || error * (level + 0.01 * random.normal()).exp();
                    run().midpoint(run())
                };
                [mean(0.9 * own.exp()), mean(1.0)]
            };
            let errors: Vec<[f64; 2]> = (0..windows).map(|_| window()).collect();
            let losses = Losses::new(&errors).unwrap();
            losses.quotient(0, 1).expect("finite").interval.expect("several windows")
        });
        assert!((coverage - 0.95).abs() < 0.02, "{windows} windows: {coverage}");
    }
}
