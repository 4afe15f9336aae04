use calib_core::{Rng, Seed, Segments, Silent, States};

use super::*;
use crate::{AgentConfig, Columns, evaluation::FittedQ, off_policy_values};

fn episode<'a>(ratios: &[f64], rewards: &'a [f32], ending: Ending) -> Episode<'a> {
    let log_ratios = ratios.iter().map(|ratio| ratio.ln()).collect();
    Episode { log_ratios, rewards, values: &[], ending }
}

#[test]
fn a_small_case_by_hand() {
    let ended = episode(&[2.0, 0.5], &[1.0, 3.0], Ending::Terminal);
    let cut = episode(&[0.5], &[2.0], Ending::Continues);
    // The first step is (2·1 + 0.5·2) / 2.5. The second one is the first episode alone.
    let estimated = estimate(&[ended.clone(), cut.clone()], 0.5, 100);
    assert!((estimated.value.expect("a value") - (1.2 + 0.5 * 3.0)).abs() < 1e-12, "{estimated:?}");
    // Whole episodes have the weights 1 and 0.5.
    assert!((estimated.effective_episodes - 2.25 / 1.25).abs() < 1e-12, "{estimated:?}");
    // After a terminal the reward is 0: 1·3 of 1.5.
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

/// Draws an episode through places 0 to 3 with −1 per step. Action 1 leads on, action 0 back, and place 3 leads to the end.
/// Action 1 has probability `forth`.
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

/// Returns the true value at place 0 of the policy that takes action 1 with probability `forth`.
fn value_of_chain(forth: f64) -> f64 {
    // v(3) = −1 + q v(2), and so on, solved by iteration.
    let mut values = [0.0_f64; 5];
    for _ in 0..1000 {
        for place in 0..4_usize {
            let back = values[place.saturating_sub(1)];
            values[place] = -1.0 + forth * values[place + 1] + (1.0 - forth) * back;
        }
    }
    values[0]
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
    let truth = value_of_chain(other);
    let estimated = estimate(&logged, 1.0, 10_000);
    let got = estimated.value.expect("a value");
    assert!((got - truth).abs() < 0.15, "{got}, not {truth}");
    let own: f64 = walks.iter().map(|steps| -(steps.len() as f64)).sum::<f64>() / 20_000.0;
    assert!((own - truth).abs() > 1.0, "the behaviour gets something else: {own}");
    assert!(
        estimated.effective_episodes > 100.0 && estimated.effective_episodes < 20_000.0,
        "{estimated:?}"
    );
}

/// Returns `count` episodes through the same chain as a log of decisions, in which a place has the state `place / scale`.
fn log_of_walks(count: usize, scale: f32, seed: Seed) -> Decisions {
    let mut rng = seed.rng();
    let mut states = Vec::new();
    let mut actions = Vec::new();
    let mut endings = Vec::new();
    let mut lengths = Vec::new();
    for _ in 0..count {
        let steps = walk(0.6, &mut rng);
        lengths.push(steps.len() + 1);
        for (place, action) in steps {
            states.push(place as f32 / scale);
            actions.push(Some(action as u16));
            endings.push(Ending::Continues);
        }
        states.push(4.0 / scale);
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

fn log() -> Decisions {
    log_of_walks(2000, 4.0, Seed::new(2))
}

#[test]
fn who_learns_to_lead_on_is_better() {
    let log = log();
    let sharp = AgentConfig { temperature: 0.3, gamma: 0.99, ..AgentConfig::default() };
    let dull = AgentConfig { temperature: 1e6, ..sharp };
    let starts = States::new(vec![0.0], 1, 1).expect("valid");
    let found =
        off_policy_values(&log, &starts, &[sharp, dull], 20_000, 100, &Silent).expect("run");
    let values = found.importance.expect("probabilities are logged");
    let [of_sharp, of_dull] = [0, 1].map(|at: usize| values[at].value.expect("a value"));
    // Going straight on takes four steps. Random actions take 20 on average, which the discount shortens.
    assert!(of_sharp > -7.0 && of_dull < -11.0, "{values:?}");
    assert!(values.iter().all(|value| value.effective_episodes > 20.0), "{values:?}");
    let robust = found.doubly_robust.expect("probabilities are logged");
    for (robust, fitted) in robust.into_iter().zip(found.fitted_q) {
        // Every place has its own tiles, and the outcomes of actions are certain, so the fitted values are right.
        let robust = robust.expect("a value");
        assert!((robust - fitted.value).abs() < 1e-3, "{robust} and {fitted:?}");
    }
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

/// Returns two episodes of 3 and 2 steps. The second one ends with `ending`.
fn two_with_values(ending: Ending) -> [Episode<'static>; 2] {
    const LONG: [StepValues; 3] = [
        StepValues { taken: 1.0, expected: 1.5 },
        StepValues { taken: 2.0, expected: 1.0 },
        StepValues { taken: 0.5, expected: 0.25 },
    ];
    const SHORT: [StepValues; 2] =
        [StepValues { taken: 0.5, expected: 2.0 }, StepValues { taken: 1.0, expected: 1.5 }];
    let long = episode(&[2.0, 0.5, 3.0], &[1.0, 3.0, -1.0], Ending::Terminal);
    let short = episode(&[0.5, 1.5], &[2.0, 0.0], ending);
    [Episode { values: &LONG, ..long }, Episode { values: &SHORT, ..short }]
}

/// Returns the weights Π π / b from the first step on, which stay as they are after an episode's last step, for up to `longest` steps:
/// `[steps][episodes]`.
fn plain_weights(episodes: &[Episode<'_>], longest: usize) -> Vec<Vec<f64>> {
    let mut all = vec![vec![1.0; episodes.len()]];
    for step in 0..longest {
        let mut weights = all[step].clone();
        for (weight, episode) in weights.iter_mut().zip(episodes) {
            if step < episode.log_ratios.len() {
                *weight *= episode.log_ratios[step].exp();
            }
        }
        all.push(weights);
    }
    all
}

/// Computes Σᵢ Σₜ γᵗ (wᵢₜ r − wᵢₜ q̂ + wᵢₜ₋₁ v̂) over episodes that ended, as in Thomas & Brunskill 2016.
fn plain_doubly_robust(episodes: &[Episode<'_>], gamma: f64) -> f64 {
    let longest = episodes.iter().map(|episode| episode.rewards.len()).max().expect("episodes");
    let weights = plain_weights(episodes, longest);
    let mut value = 0.0;
    for (number, episode) in episodes.iter().enumerate() {
        for step in 0..episode.rewards.len() {
            let before = weights[step][number] / weights[step].iter().sum::<f64>();
            let after = weights[step + 1][number] / weights[step + 1].iter().sum::<f64>();
            let StepValues { taken, expected } = episode.values[step];
            let reward = f64::from(episode.rewards[step]);
            let part = after * reward - after * taken + before * expected;
            value += gamma.powi(step as i32) * part;
        }
    }
    value
}

/// Computes Σₜ γᵗ Σᵢ ρᵢₜ rᵢₜ / Σᵢ ρᵢₜ over episodes that ended.
fn plain_importance_sampling(episodes: &[Episode<'_>], gamma: f64) -> f64 {
    let longest = episodes.iter().map(|episode| episode.rewards.len()).max().expect("episodes");
    let weights = plain_weights(episodes, longest);
    let mut value = 0.0;
    for step in 0..longest {
        let mut sum = 0.0;
        for (weight, episode) in weights[step + 1].iter().zip(episodes) {
            sum += weight * episode.rewards.get(step).copied().map_or(0.0, f64::from);
        }
        value += gamma.powi(step as i32) * sum / weights[step + 1].iter().sum::<f64>();
    }
    value
}

fn assert_near(got: f64, expected: f64) {
    assert!((got - expected).abs() < 1e-12, "{got}, not {expected}");
}

/// Random numbers of one episode.
struct DrawnEpisode {
    ratios: Vec<f64>,
    rewards: Vec<f32>,
    values: Vec<StepValues>,
}

/// Draws episodes of 1 to 9 steps with random values.
fn drawn_episodes(seed: u64) -> Vec<DrawnEpisode> {
    let mut rng = Seed::new(seed).rng();
    let mut all = Vec::new();
    for _ in 0..12 {
        let steps = 1 + rng.below(9);
        all.push(DrawnEpisode {
            ratios: (0..steps).map(|_| rng.uniform(0.1, 3.0)).collect(),
            rewards: (0..steps).map(|_| rng.uniform(-2.0, 2.0) as f32).collect(),
            values: (0..steps)
                .map(|_| StepValues { taken: rng.normal(), expected: rng.normal() })
                .collect(),
        });
    }
    all
}

impl DrawnEpisode {
    fn logged(&self) -> Episode<'_> {
        Episode { values: &self.values, ..episode(&self.ratios, &self.rewards, Ending::Terminal) }
    }
}

#[test]
fn a_doubly_robust_case_by_hand() {
    let ended = two_with_values(Ending::Terminal);
    let estimated = estimate(&ended, 0.5, 100);
    let got = estimated.value.expect("a value");
    // The weights are 2 and 0.5, then 1 and 0.75, then 3 and 0.75. The first step is 1.75 + (2·0 + 0.5·1.5) / 2.5, the second one 1.1 +
    // 0.25 / 1.75, and the third one 0.25 / 1.75 − 4.5 / 3.75.
    assert_near(got, 2.05 + 0.5 * (1.1 + 1.0 / 7.0) + 0.25 * (1.0 / 7.0 - 1.2));
    assert_near(got, plain_doubly_robust(&ended, 0.5));
    // It uses the same episodes as importance sampling.
    let alone = ended.map(|episode| Episode { values: &[], ..episode });
    assert_eq!(estimated.effective_episodes, estimate(&alone, 0.5, 100).effective_episodes);
    // If the second episode is cut, the third step is that of the first episode alone: 0.25 − 1.5.
    let cut = two_with_values(Ending::Continues);
    let got = estimate(&cut, 0.5, 100).value.expect("a value");
    assert_near(got, 2.05 + 0.5 * (1.1 + 1.0 / 7.0) - 0.25 * 1.25);
    assert_near(estimate(&cut, 0.5, 1).value.expect("a value"), 2.05);
}

#[test]
fn the_doubly_robust_estimate_is_that_of_a_plain_loop() {
    for seed in 0..20 {
        let drawn = drawn_episodes(seed);
        let logged: Vec<Episode<'_>> = drawn.iter().map(DrawnEpisode::logged).collect();
        let got = estimate(&logged, 0.9, 100).value.expect("a value");
        assert_near(got, plain_doubly_robust(&logged, 0.9));
    }
}

#[test]
fn without_fitted_values_it_is_importance_sampling() {
    let nought = [StepValues::default(); 9];
    for seed in 0..20 {
        let drawn = drawn_episodes(seed);
        let alone: Vec<Episode<'_>> =
            drawn.iter().map(|one| Episode { values: &[], ..one.logged() }).collect();
        let zero: Vec<Episode<'_>> =
            drawn.iter().map(|one| Episode { values: &nought, ..one.logged() }).collect();
        let estimated = estimate(&zero, 0.9, 100);
        assert_eq!(estimated, estimate(&alone, 0.9, 100));
        let got = estimated.value.expect("a value");
        assert_near(got, plain_importance_sampling(&zero, 0.9));
    }
}

#[test]
fn of_the_behaviour_itself_it_is_the_mean_return() {
    for seed in 0..20 {
        let mut drawn = drawn_episodes(seed);
        let mut returns = 0.0;
        for one in &mut drawn {
            // The evaluated policy is the behaviour, which always takes the recorded action: ratios are 1, and v̂ is q̂ of that action.
            one.ratios.fill(1.0);
            for values in &mut one.values {
                values.expected = values.taken;
            }
            for (step, &reward) in one.rewards.iter().enumerate() {
                returns += 0.9_f64.powi(step as i32) * f64::from(reward);
            }
        }
        let logged: Vec<Episode<'_>> = drawn.iter().map(DrawnEpisode::logged).collect();
        let got = estimate(&logged, 0.9, 100).value.expect("a value");
        assert_near(got, returns / drawn.len() as f64);
        // Cut episodes count as they do without fitted values.
        let mut cut = logged;
        for one in &mut cut {
            if one.rewards.len().is_multiple_of(2) {
                one.ending = Ending::Continues;
            }
        }
        let got = estimate(&cut, 0.9, 100).value.expect("a value");
        let alone: Vec<Episode<'_>> =
            cut.into_iter().map(|one| Episode { values: &[], ..one }).collect();
        assert_near(got, estimate(&alone, 0.9, 100).value.expect("a value"));
    }
}

#[test]
fn with_right_values_wrong_probabilities_do_not_matter() {
    for seed in 0..20 {
        let mut drawn = drawn_episodes(seed);
        let mut firsts = 0.0;
        for one in &mut drawn {
            let mut ahead = 0.0;
            for (values, &reward) in one.values.iter_mut().zip(&one.rewards).rev() {
                values.taken = f64::from(reward) + 0.9 * ahead;
                ahead = values.expected;
            }
            firsts += ahead;
        }
        let logged: Vec<Episode<'_>> = drawn.iter().map(DrawnEpisode::logged).collect();
        let got = estimate(&logged, 0.9, 100).value.expect("a value");
        assert_near(got, firsts / drawn.len() as f64);
    }
}

#[test]
fn coarse_fitted_values_bring_the_estimate_nearer_to_the_truth() {
    let other = 0.8;
    let truth = value_of_chain(other);
    let start = States::new(vec![0.0], 1, 1).expect("valid");
    let mut sampled_error = 0.0;
    let mut fitted_error = 0.0;
    let mut robust_error = 0.0;
    for seed in 0..40 {
        // Neighbouring places share tiles, so the fitted values are wrong.
        let log = log_of_walks(20, 64.0, Seed::new(seed));
        let policies = [1.0 - other, other].repeat(log.len());
        let ratios = log_ratios(&log, log.probabilities().expect("logged"), &policies);
        let mut fitted = FittedQ::fit(&log, &policies, 1.0, 100, &Silent).expect("run");
        let values = fitted.at_steps(&log, &policies);
        let sampled = estimate(&episodes(&log, &ratios, &[]), 1.0, 1000);
        let robust = estimate(&episodes(&log, &ratios, &values), 1.0, 1000);
        sampled_error += (sampled.value.expect("a value") - truth).abs();
        fitted_error += (fitted.mean_over(&start, &policies[..2]) - truth).abs();
        robust_error += (robust.value.expect("a value") - truth).abs();
    }
    let told = format!("{sampled_error} sampled, {fitted_error} fitted, {robust_error} both");
    assert!(robust_error < 0.75 * sampled_error, "{told}");
    assert!(robust_error < 0.75 * fitted_error, "{told}");
}

#[test]
fn what_diverged_has_no_doubly_robust_value() {
    let log = log();
    let starts = States::new(vec![0.0], 1, 1).expect("valid");
    // This is too large for the single precision of the agent's weights.
    let diverged = AgentConfig { initial_weight: 1e300, ..AgentConfig::default() };
    let candidates = [diverged, AgentConfig::default()];
    let found = off_policy_values(&log, &starts, &candidates, 1000, 100, &Silent).expect("run");
    let [lost, kept] = found.fitted_q[..] else { panic!("{found:?}") };
    assert!(lost.value == f64::NEG_INFINITY && !lost.converged, "{found:?}");
    assert!(kept.value.is_finite(), "{found:?}");
    let robust = found.doubly_robust.expect("probabilities are logged");
    assert!(robust[0].is_none() && robust[1].is_some(), "{robust:?}");
    let none = off_policy_values(&log, &starts, &[], 1000, 100, &Silent).expect("run");
    assert_eq!((none.importance, none.doubly_robust), (None, None), "no candidates");
}
