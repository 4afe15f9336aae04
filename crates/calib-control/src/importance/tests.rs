use calib_core::{Rng, Seed, Segments, Silent, States};

use super::*;
use crate::Columns;

fn episode<'a>(ratios: &[f64], rewards: &'a [f32], ending: Ending) -> Episode<'a> {
    Episode { log_ratios: ratios.iter().map(|ratio| ratio.ln()).collect(), rewards, ending }
}

#[test]
fn a_small_case_by_hand() {
    let ended = episode(&[2.0, 0.5], &[1.0, 3.0], Ending::Terminal);
    let cut = episode(&[0.5], &[2.0], Ending::Continues);
    // First step: (2·1 + 0.5·2) / 2.5; second: the first episode alone.
    let estimated = estimate(&[ended.clone(), cut.clone()], 0.5, 100);
    assert!((estimated.value.expect("a value") - (1.2 + 0.5 * 3.0)).abs() < 1e-12, "{estimated:?}");
    // Whole episodes weigh 1 and 0.5.
    assert!((estimated.effective_episodes - 2.25 / 1.25).abs() < 1e-12, "{estimated:?}");
    // After a terminal nought is got: 1·3 of 1.5.
    let other = Episode { ending: Ending::Terminal, ..cut };
    let estimated = estimate(&[ended.clone(), other], 0.5, 100);
    assert!((estimated.value.expect("a value") - (1.2 + 0.5 * 2.0)).abs() < 1e-12, "{estimated:?}");
    assert_eq!(estimate(&[ended], 0.5, 1).value, Some(1.0), "cut at the timeout");
}

#[test]
fn what_never_happened_has_no_value() {
    let never = episode(&[0.0, 1.0], &[1.0, 1.0], Ending::Terminal);
    let none = Importance { value: None, effective_episodes: 0.0 };
    assert_eq!(estimate(&[never], 1.0, 10), none);
}

#[test]
fn products_beyond_the_range_of_numbers_still_count() {
    let large = vec![1e9; 200];
    let small = vec![1e-9; 200];
    let rewards = vec![1.0_f32; 200];
    let nothing = vec![0.0_f32; 200];
    let both = [
        episode(&large, &rewards, Ending::Continues),
        episode(&small, &nothing, Ending::Continues),
    ];
    let estimated = estimate(&both, 1.0, 1000);
    assert!((estimated.value.expect("a value") - 200.0).abs() < 1e-6, "{estimated:?}");
    assert!((estimated.effective_episodes - 1.0).abs() < 1e-6, "{estimated:?}");
}

/// Places 0 to 3, −1 a step; action 1 leads on, action 0 back; after place 3 it ends. Action 1 is taken with probability `forth`.
fn walk(forth: f64, rng: &mut Rng) -> Vec<(usize, usize)> {
    let mut place = 0_usize;
    let mut steps = Vec::new();
    while place < 4 {
        let action = usize::from(rng.unit() < forth);
        steps.push((place, action));
        place = if action == 1 { place + 1 } else { place.saturating_sub(1) };
    }
    steps
}

#[test]
fn the_value_of_another_policy_is_the_truth_of_a_chain() {
    let behaviour = 0.6;
    let other = 0.8;
    let mut rng = Seed::new(1).rng();
    let walks: Vec<_> = (0..20_000).map(|_| walk(behaviour, &mut rng)).collect();
    let rewards = vec![-1.0_f32; 10_000];
    let logged: Vec<Episode<'_>> = walks
        .iter()
        .map(|steps| {
            let ratios = steps.iter().map(|&(_, action)| {
                if action == 1 { other / behaviour } else { (1.0 - other) / (1.0 - behaviour) }
            });
            let ratios: Vec<f64> = ratios.collect();
            episode(&ratios, &rewards[..steps.len()], Ending::Terminal)
        })
        .collect();
    // v(3) = −1 + q v(2), and so on; solved by going over it.
    let mut values = [0.0_f64; 5];
    for _ in 0..1000 {
        for place in 0..4_usize {
            let back = values[place.saturating_sub(1)];
            values[place] = -1.0 + other * values[place + 1] + (1.0 - other) * back;
        }
    }
    let estimated = estimate(&logged, 1.0, 10_000);
    let got = estimated.value.expect("a value");
    assert!((got - values[0]).abs() < 0.15, "{got}, not {}", values[0]);
    let own: f64 = walks.iter().map(|steps| -(steps.len() as f64)).sum::<f64>() / 20_000.0;
    assert!((own - values[0]).abs() > 1.0, "the behaviour gets something else: {own}");
    assert!(
        estimated.effective_episodes > 100.0 && estimated.effective_episodes < 20_000.0,
        "{estimated:?}"
    );
}

/// The same chain as a log of decisions.
fn log() -> Decisions {
    let mut rng = Seed::new(2).rng();
    let mut states = Vec::new();
    let mut actions = Vec::new();
    let mut endings = Vec::new();
    let mut lengths = Vec::new();
    for _ in 0..2000 {
        let steps = walk(0.6, &mut rng);
        lengths.push(steps.len() + 1);
        for (place, action) in steps {
            states.push(place as f32 / 4.0);
            actions.push(Some(action as u16));
            endings.push(Ending::Continues);
        }
        states.push(1.0);
        actions.push(None);
        endings.push(Ending::Terminal);
    }
    let rows = states.len();
    let probabilities: Vec<f64> = actions
        .iter()
        .map(|action| action.map_or(f64::NAN, |action| [0.4, 0.6][usize::from(action)]))
        .collect();
    let columns = Columns { actions: &actions, rewards: &vec![-1.0; rows], endings: &endings };
    let states = States::new(states, rows, 1).expect("valid");
    let segments = Segments::from_lengths(lengths).expect("valid");
    let log = Decisions::new(states, &segments, columns, 2).expect("a log");
    log.with_probabilities(&probabilities).expect("probabilities")
}

#[test]
fn who_learns_to_lead_on_is_better() {
    let log = log();
    let sharp = AgentConfig { temperature: 0.3, gamma: 0.99, ..AgentConfig::default() };
    let dull = AgentConfig { temperature: 1e6, ..sharp };
    let values = importance_sampling(&log, &[sharp, dull], 20_000, 100, &Silent).expect("run");
    let values = values.expect("probabilities are logged");
    let value_at = |at: usize| values[at].value.expect("a value");
    // Straight on it takes four steps; by chance 20 in the mean, which the discount shortens.
    assert!(value_at(0) > -7.0 && value_at(1) < -11.0, "{values:?}");
    assert!(values.iter().all(|value| value.effective_episodes > 20.0), "{values:?}");
}

#[test]
fn probabilities_are_checked() {
    let log = log();
    let rows = log.states().rows();
    for bad in [0.0, 1.5, f64::NAN] {
        let told = log.clone().with_probabilities(&vec![bad; rows]).expect_err("no probability");
        assert!(told.to_string().contains("row 0"), "{told}");
    }
    assert!(log.clone().with_probabilities(&[0.5]).is_err(), "one row");
}
