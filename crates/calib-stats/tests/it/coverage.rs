//! The coverage of 95 % intervals in simulations.

use calib_stats::{
    Interval, Losses, Nested, choose_by_mean_log, column_means, error_ratio, hierarchical,
    jackknife, jackknife_of_kinds, paired_difference, ratio_of_sums, summarise, summarise_clusters,
    summarise_overlapping, upper_bound,
};

use crate::random::Random;

const STUDIES: usize = 2000;

/// Returns the share of simulated studies whose interval contains `truth`. Its standard error is 0.5 % near 95 %.
fn coverage(truth: f64, mut interval: impl FnMut() -> Interval) -> f64 {
    let held = (0..STUDIES).filter(|_| {
        let Interval { low, high } = interval();
        low <= truth && truth <= high
    });
    held.count() as f64 / STUDIES as f64
}

/// Returns distances from 6 start states, 5 ensemble members each. Start states differ by 1, members of a start state
/// by 0.5.
fn distances(random: &mut Random) -> (Vec<usize>, Vec<f64>) {
    let mut starts = Vec::new();
    let mut distances = Vec::new();
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
        // A start state has an extra difficulty for the other model, with half the spread of the shared one.
        let of_starts: Vec<f64> = (0..6).map(|_| 0.5 * random.normal()).collect();
        let x: Vec<f64> =
            starts.iter().zip(&y).map(|(&start, y)| y - 0.3 + of_starts[start]).collect();
        paired_difference(&starts, &x, &y).unwrap().interval.expect("six starts")
    });
    assert!((paired - 0.95).abs() < 0.02, "{paired}");
}

/// Returns autocorrelated squared errors: AR(1) with a memory of ten steps.
fn errors(random: &mut Random, steps: usize, scale: f64) -> Vec<f64> {
    let mut error = random.normal();
    let squares = (0..steps).map(|_| {
        error = 0.9 * error + (1.0 - 0.81_f64).sqrt() * random.normal();
        (scale * error).powi(2)
    });
    squares.collect()
}

#[test]
fn quotients_of_errors_that_depend_on_each_other_hold_the_truth() {
    let mut random = Random::new(3);
    let coverage = coverage(0.8, || {
        let x = errors(&mut random, 2000, 0.8);
        let y = errors(&mut random, 2000, 1.0);
        error_ratio(&x, &y).unwrap().expect("defined").interval.expect("sixteen stretches")
    });
    assert!((coverage - 0.95).abs() < 0.025, "{coverage}");
}

/// Returns the errors of two candidates in a window, the first of which is better by a tenth. Windows differ in a
/// level that both share, and in a factor of the first alone. Two runs differ within a window.
fn window(random: &mut Random) -> [f64; 2] {
    let level = random.normal();
    let own = 0.05 * random.normal();
    [0.9 * own.exp(), 1.0].map(|error| {
        let mut run = || error * (level + 0.01 * random.normal()).exp();
        run().midpoint(run())
    })
}

#[test]
fn intervals_over_windows_hold_the_quotient_however_few_there_are() {
    let mut random = Random::new(4);
    for windows in [2, 3, 8] {
        let coverage = coverage(0.9, || {
            let errors: Vec<[f64; 2]> = (0..windows).map(|_| window(&mut random)).collect();
            let losses = Losses::new(&errors).unwrap();
            losses.quotient(0, 1).expect("finite").interval.expect("several windows")
        });
        assert!((coverage - 0.95).abs() < 0.02, "{windows} windows: {coverage}");
    }
}

/// A distribution of non-negative losses, with its mean.
struct Loss {
    name: &'static str,
    mean: f64,
    draw: fn(&mut Random) -> f64,
    /// Required coverage of bounds over 4, 8 and 16 windows.
    least: f64,
}

fn exponential(random: &mut Random) -> f64 {
    -random.unit().ln()
}

/// Possible losses of a choice in a window: nearly symmetric ones first, those with a long tail or mostly 0 last.
const LOSSES: [Loss; 8] = [
    Loss {
        name: "half normal",
        mean: 0.797_884_6,
        draw: |random| random.normal().abs(),
        least: 0.99,
    },
    Loss {
        name: "square, off by one",
        mean: 2.0,
        draw: |random| (1.0 + random.normal()).powi(2),
        least: 0.95,
    },
    Loss { name: "square", mean: 1.0, draw: |random| random.normal().powi(2), least: 0.94 },
    Loss { name: "exponential", mean: 1.0, draw: exponential, least: 0.98 },
    Loss {
        name: "log-normal, 1",
        mean: 1.648_721_3,
        draw: |random| random.normal().exp(),
        least: 0.98,
    },
    Loss {
        name: "log-normal, 1.5",
        mean: 3.080_216_8,
        draw: |random| (1.5 * random.normal()).exp(),
        least: 0.85,
    },
    Loss {
        name: "half are nought",
        mean: 0.5,
        draw: |random| if random.unit() < 0.5 { 0.0 } else { exponential(random) },
        least: 0.94,
    },
    Loss {
        name: "three quarters are nought",
        mean: 0.25,
        draw: |random| if random.unit() < 0.75 { 0.0 } else { exponential(random) },
        least: 0.94,
    },
];

#[test]
fn bounds_of_regret_hold_the_mean_where_student_s_t_does_not() {
    let mut random = Random::new(5);
    let mut worst_of_t = 1.0_f64;
    for Loss { name, mean, draw, least } in LOSSES {
        for windows in [4, 8, 16] {
            let mut given = 0;
            let mut held = 0;
            let mut held_by_t = 0;
            for _ in 0..STUDIES {
                let losses: Vec<f64> = (0..windows).map(|_| draw(&mut random)).collect();
                let Some(upper) = upper_bound(&losses).expect("losses") else { continue };
                let t = summarise(&losses).unwrap().interval.expect("they differ");
                given += 1;
                held += u32::from(mean <= upper);
                held_by_t += u32::from(mean <= t.high);
            }
            let [held, held_by_t] =
                [held, held_by_t].map(|times| f64::from(times) / f64::from(given));
            println!("{name}, {windows} windows: {given} given, {held:.3}, by t {held_by_t:.3}");
            assert!(held >= least, "{name}, {windows} windows: {held}");
            worst_of_t = worst_of_t.min(held_by_t);
        }
    }
    assert!(worst_of_t < 0.85, "{worst_of_t}");
}

/// Returns an estimate for each member of a log of five blocks. Each member lacks one block: its estimate is the mean
/// of the other blocks, plus the noise of `runs` runs.
fn members(random: &mut Random, noise: f64, runs: usize) -> Vec<f64> {
    let blocks: Vec<f64> = (0..5).map(|_| random.normal()).collect();
    let sum: f64 = blocks.iter().sum();
    let estimates = blocks
        .iter()
        .map(|block| (sum - block) / 4.0 + noise * random.normal() / (runs as f64).sqrt());
    estimates.collect()
}

#[test]
fn intervals_over_members_hold_what_other_logs_say() {
    let mut random = Random::new(6);
    // A run varies as much as members do, or nine times as much.
    for noise in [0.25, 2.25] {
        let mut all = Vec::new();
        for runs in [1, 3, 20] {
            let own = coverage(0.0, || {
                let members = members(&mut random, noise, runs);
                let mean = members.iter().sum::<f64>() / 5.0;
                jackknife(mean, &members).expect("five members")
            });
            let as_if_independent = coverage(0.0, || {
                summarise(&members(&mut random, noise, runs)).unwrap().interval.expect("five")
            });
            println!(
                "noise {noise}, {runs} runs: {own:.3}, as if independent {as_if_independent:.3}"
            );
            assert!(own > 0.94, "{own} with {runs} runs");
            all.push(as_if_independent);
        }
        assert!(all[2] < 0.8 && all[0] > all[2], "shrinks with runs: {all:?}");
    }
}

/// Returns what three kinds of members find, `[kinds][blocks]`. Each lacks a block of the log. A block changes what all kinds find, and
/// `own` times as much what each kind finds by itself. Members of a kind differ by their noise.
fn kinds(random: &mut Random, own: f64, noise: f64) -> Vec<Vec<f64>> {
    let shared = members(random, 0.0, 1);
    let mut kinds = Vec::new();
    for _ in 0..3 {
        let of_kind = members(random, 0.0, 1);
        let both = shared.iter().zip(&of_kind).map(|(shared, of_kind)| shared + own * of_kind);
        kinds.push(both.map(|value| value + noise * random.normal()).collect());
    }
    kinds
}

#[test]
fn the_noise_of_runs_is_left_out_where_kinds_show_it() {
    let mut random = Random::new(7);
    // What a block changes in one kind alone counts as noise.
    for (own, least) in [(0.0, 0.91), (1.0, 0.88), (2.0, 0.86)] {
        for noise in [0.0, 0.1, 0.2, 0.3, 0.5, 1.0, 3.0] {
            let mut widths = Vec::new();
            let held = coverage(0.0, || {
                let kinds = kinds(&mut random, own, noise);
                let blocks = column_means(&kinds);
                let mean = blocks.iter().sum::<f64>() / 5.0;
                let interval = jackknife_of_kinds(mean, &kinds).expect("five blocks");
                let plain = jackknife(mean, &blocks).expect("five blocks");
                widths.push((interval.high - mean) / (plain.high - mean));
                interval
            });
            let width = widths.iter().sum::<f64>() / widths.len() as f64;
            println!(
                "own effect {own}, noise {noise}: {held:.3}, {width:.2} of the jackknife's width"
            );
            assert!(held > least, "{held} with effect {own} and noise {noise}");
            assert!(noise < 1.0 || width < 0.8, "{width} with effect {own} and noise {noise}");
        }
    }
}

/// Returns the mean error over each of `count` windows of 100 rows, evenly spread over `rows` rows of independent
/// errors.
fn windows(random: &mut Random, rows: usize, count: usize) -> Vec<f64> {
    let errors: Vec<f64> = (0..rows).map(|_| random.normal()).collect();
    let means = (0..count).map(|window| {
        let start = window * (rows - 100) / (count - 1);
        errors[start..][..100].iter().sum::<f64>() / 100.0
    });
    means.collect()
}

#[test]
fn windows_that_overlap_in_a_chain_hold_the_mean_where_they_count_as_often_as_they_fit() {
    let mut random = Random::new(7);
    // Fifteen windows share a third, and three quarters, of their rows with the next.
    for (rows, independent) in [(1040, 10), (450, 4)] {
        let own = coverage(0.0, || {
            let windows = windows(&mut random, rows, 15);
            summarise_overlapping(&windows, independent).unwrap().interval.expect("several")
        });
        println!("{rows} rows: {own:.3}");
        assert!(own > 0.94, "{rows} rows: {own}");
        let each = coverage(0.0, || {
            summarise(&windows(&mut random, rows, 15)).unwrap().interval.expect("fifteen")
        });
        assert!(each < 0.9, "{rows} rows: {each}");
    }
}

#[test]
fn recorded_returns_hold_the_mean_where_episodes_are_cut() {
    let mut random = Random::new(8);
    // An episode is 100 steps of −1 ± 1 each. Two of seven are cut somewhere.
    let own = coverage(-100.0, || {
        let shares: [f64; 7] = [1.0, 1.0, 1.0, 1.0, 1.0, 0.3, 0.6];
        let rewards = shares.map(|share| -100.0 * share + 10.0 * share.sqrt() * random.normal());
        ratio_of_sums(&rewards, &shares).unwrap().interval.expect("seven")
    });
    println!("{own:.3}");
    assert!((own - 0.95).abs() < 0.02, "{own}");
}

/// Returns the value that is chosen of seven on a grid from a log of five blocks. Also returns the share of 200
/// resamples that choose it, and the share that choose it or a neighbour.
fn chosen_from_a_log(random: &mut Random) -> (usize, f64, f64) {
    // The best value is in the middle. The best value of a block differs by a place and a half.
    let optima: Vec<f64> = (0..5).map(|_| 3.0 + 1.5 * random.normal()).collect();
    let mut run = |blocks: &[f64]| -> Vec<f64> {
        (0..7)
            .map(|value| {
                let errors =
                    blocks.iter().map(|&optimum| 0.03 * (f64::from(value) - optimum).powi(2));
                (errors.sum::<f64>() / blocks.len() as f64 + 0.05 * random.normal()).exp()
            })
            .collect()
    };
    let members = (0..5).map(|left_out| {
        let rest: Vec<f64> =
            (0..5).filter(|block| *block != left_out).map(|block| optima[block]).collect();
        (0..3).map(|_| run(&rest)).collect()
    });
    let members = Nested::new(members.collect()).expect("members");
    let windows = (0..15).map(|window| vec![run(&optima[window % 5..][..1])]);
    let windows = Nested::new(windows.collect()).expect("windows");
    let chosen = choose_by_mean_log(&[members.whole().runs(), windows.whole().runs()]);
    let chosen = chosen.expect("finite").chosen.expect("one");
    let choices = hierarchical(
        &[&members, &windows],
        200,
        |below: usize| ((random.unit() * below as f64) as usize).min(below - 1),
        |drawn| Ok(choose_by_mean_log(&[drawn[0].runs(), drawn[1].runs()])?.chosen),
    );
    let counts = choices.expect("chosen").counts;
    let nearby: usize = counts[chosen.saturating_sub(1)..=(chosen + 1).min(6)].iter().sum();
    (chosen, counts[chosen] as f64 / 200.0, nearby as f64 / 200.0)
}

#[test]
fn shares_of_resamples_are_not_what_another_log_chooses() {
    const LOGS: usize = 300;
    let mut random = Random::new(9);
    let mut share = 0.0;
    let mut same = 0.0;
    let mut share_nearby = 0.0;
    let mut near = 0.0;
    for _ in 0..LOGS {
        let (one, own, nearby) = chosen_from_a_log(&mut random);
        let (other, _, _) = chosen_from_a_log(&mut random);
        share += own / LOGS as f64;
        share_nearby += nearby / LOGS as f64;
        same += f64::from(u8::from(one == other)) / LOGS as f64;
        near += f64::from(u8::from(one.abs_diff(other) < 2)) / LOGS as f64;
    }
    println!("{share:.2} {same:.2}, nearby {share_nearby:.2} {near:.2}");
    assert!(share > same + 0.1 && share_nearby > near, "{share} {same}, {share_nearby} {near}");
    assert!(share_nearby - near < share - same, "with what is beside it the two are nearer");
}
