use std::sync::atomic::{AtomicU64, Ordering};

use calib_core::{Cancelled, Rng, RowIndex, RowStream, Segments, Silent, States};

use super::*;
use crate::{
    OptimiserKind, Part, PartScore, Precision, ReplayKind, ValueFunction, discounted_returns,
    truncation_horizon,
};

fn unbroken(values: Vec<f32>, width: usize, order: impl IntoIterator<Item = usize>) -> RowStream {
    let rows = values.len() / width;
    let states = States::new(values, rows, width).expect("valid");
    RowStream::unbroken(states, order.into_iter().map(RowIndex::new).collect())
}

/// Returns a slow wave, its derivative, and a little noise.
pub(crate) fn waves(steps: usize) -> RowStream {
    let mut rng: Rng = Seed::new(11).rng();
    let values = (0..steps).flat_map(|t| {
        let phase = t as f64 * 0.05;
        let state = [0.5 + 0.4 * phase.sin(), 0.5 + 0.4 * phase.cos()];
        state.map(|value| (value + 0.01 * rng.normal()) as f32)
    });
    unbroken(values.collect(), 2, 0..steps)
}

/// Returns the same waves in segments of these lengths.
pub(crate) fn waves_in<const SEGMENTS: usize>(lengths: [usize; SEGMENTS]) -> RowStream {
    let steps = lengths.iter().sum();
    let whole = waves(steps);
    let values = (0..steps).flat_map(|t| whole.state(t).to_vec()).collect();
    let states = States::new(values, steps, 2).expect("valid");
    RowStream::replay(states, &Segments::from_lengths(lengths).expect("valid"))
}

fn run(stream: &RowStream, agents: &[AgentConfig]) -> Vec<RunOutcome> {
    let curve = CurveRule { windows: 20 };
    train(stream, 0, agents, curve, Seed::new(5), &Silent).expect("trains")
}

fn whole(outcome: &RunOutcome) -> PartScore {
    outcome.scores.of(Part::WholeRun).expect("scored")
}

/// Returns the score after the agent has settled.
fn settled(outcome: &RunOutcome) -> PartScore {
    outcome.scores.of(Part::FinalQuarter).expect("scored")
}

pub(crate) fn linear() -> AgentConfig {
    AgentConfig {
        value_function: ValueFunction::Linear,
        optimiser: OptimiserKind::Sgd,
        learning_rate: 0.1,
        gamma: 0.9,
        batch_size: 16,
        ..AgentConfig::default()
    }
}

pub(crate) fn mlp() -> AgentConfig {
    AgentConfig { hidden_units: 12, gamma: 0.9, batch_size: 16, ..AgentConfig::default() }
}

#[test]
fn a_constant_sensor_is_worth_its_value_over_one_minus_gamma() {
    let stream = unbroken(vec![0.3, 0.7], 2, vec![0; 6_000]);
    let agents = [linear(), AgentConfig { learning_rate: 1e-2, ..mlp() }];
    for outcome in run(&stream, &agents) {
        let score = settled(&outcome);
        assert!((score.mean_return - 0.3 / 0.1).abs() < 0.01, "{outcome:?}");
        // Returns next to the horizon lack up to 1 %.
        assert!(score.rmse < 0.003 * score.mean_return, "{outcome:?}");
        assert_eq!(outcome.steps, 5_999);
        assert_eq!(score.scored_steps, 1_501 - truncation_horizon(0.9));
        assert_eq!(outcome.updates, 6_000 - 1 - 15);
    }
}

#[test]
fn a_ring_of_states_gets_its_true_values() {
    let width = 5;
    let states: Vec<f32> =
        (0..width * width).map(|i| if i % (width + 1) == 0 { 1.0 } else { 0.0 }).collect();
    let stream = unbroken(states, width, (0..8_000).map(|t| t % width));
    for outcome in run(&stream, &[linear()]) {
        // o = 1 every fifth step: mean return 1/5 / (1 − γ) = 2, spread known.
        let score = settled(&outcome);
        assert!((score.mean_return - 2.0).abs() < 0.01, "{outcome:?}");
        assert!(score.rmse < 0.05 * score.return_std, "{outcome:?}");
        let curve = &outcome.curve;
        assert_eq!(curve.len(), 20);
        assert!(curve[0].rmse > 10.0 * curve[19].rmse, "{curve:?}");
    }
}

#[test]
fn a_network_predicts_a_wave() {
    let stream = waves(6_000);
    let rounded = AgentConfig { precision: Precision::Bf16, ..mlp() };
    let outcomes = run(&stream, &[mlp(), rounded]);
    for outcome in &outcomes {
        let score = settled(outcome);
        assert!(score.rmse < 0.2 * score.return_std, "{outcome:?}");
    }
    let [single, rounded] = [0, 1].map(|agent| whole(&outcomes[agent]).rmse);
    assert!(single != rounded && (single / rounded - 1.0).abs() < 0.05, "{single} {rounded}");
}

/// Returns the value of features under the weights of a linear value function.
pub(crate) fn weighted_sum(w: &[f64], x: [f64; 3]) -> f64 {
    x.iter().zip(w).map(|(x, w)| x * w).sum()
}

/// Checks against the whole algorithm, written as plainly as possible and in f64: online, linear, piece
/// by piece.
#[test]
fn the_online_agent_is_the_textbooks() {
    let stream = waves_in([50, 1, 30, 39]);
    let config = AgentConfig { replay: ReplayKind::None, gamma: 0.6, ..linear() };
    let outcome = &run(&stream, std::slice::from_ref(&config))[0];

    let initial = calib_nn::Mlp::new(&[2, 1], Seed::new(5).child("parameters"));
    let mut w: Vec<f64> = initial.parameters().iter().map(|&p| f64::from(p)).collect();
    let rows: Vec<[f64; 3]> = (0..stream.len())
        .map(|t| [f64::from(stream.state(t)[0]), f64::from(stream.state(t)[1]), 1.0])
        .collect();
    let returns = discounted_returns(&stream, 0, config.gamma);
    let horizon = truncation_horizon(config.gamma);
    let mut sum = 0.0;
    let mut count = 0;
    let mut updates = 0;
    for piece in [0..50, 50..51, 51..81, 81..120] {
        for (t, target) in returns.iter().enumerate().take(piece.end - 1).skip(piece.start) {
            if t >= 89 && t < piece.end - horizon {
                sum += (weighted_sum(&w, rows[t]) - target).powi(2);
                count += 1;
            }
            let td_error = rows[t + 1][0] + config.gamma * weighted_sum(&w, rows[t + 1])
                - weighted_sum(&w, rows[t]);
            for (w, x) in w.iter_mut().zip(rows[t]) {
                *w += config.learning_rate * td_error * x;
            }
            updates += 1;
        }
    }
    let score = settled(outcome);
    assert_eq!(score.scored_steps, count);
    assert_eq!(outcome.updates, updates);
    let expected = (sum / f64::from(count as u32)).sqrt();
    assert!((score.rmse - expected).abs() < 1e-5, "{} {expected}", score.rmse);
}

#[test]
fn a_population_changes_nothing_about_its_agents() {
    let stream = waves(400);
    let agents = [
        AgentConfig { learning_rate: 1e-2, ..mlp() },
        linear(),
        AgentConfig { learning_rate: 1e-4, ..mlp() },
        AgentConfig { learning_rate: 1e3, optimiser: OptimiserKind::Sgd, ..mlp() },
        AgentConfig { hidden_units: 7, hidden_layers: 3, updates_per_step: 2, ..mlp() },
        AgentConfig { optimiser: OptimiserKind::Adam, learning_rate: 1e-2, ..linear() },
        AgentConfig { target_network_period: 10, ..mlp() },
        AgentConfig { target_network_period: 7, ..linear() },
        AgentConfig { gamma: 0.5, ..linear() },
        AgentConfig { learning_rate: 1e8, ..linear() },
        AgentConfig { replay: ReplayKind::None, ..mlp() },
        AgentConfig { replay: ReplayKind::None, weight_decay: 0.1, ..linear() },
        AgentConfig { replay: ReplayKind::None, learning_rate: 0.02, ..linear() },
        AgentConfig { replay_capacity: 50, ..linear() },
        AgentConfig { beta1: 0.5, ..mlp() },
        AgentConfig { beta2: 0.9, ..mlp() },
        AgentConfig { epsilon: 1e-3, ..mlp() },
        AgentConfig { weight_decay: 0.1, ..mlp() },
        AgentConfig { batch_size: 8, ..mlp() },
        AgentConfig { traces: vec![0.9], ..mlp() },
        AgentConfig { traces: vec![0.9], ..linear() },
        AgentConfig { traces: vec![0.5, 0.9], ..linear() },
        AgentConfig { traces: vec![0.9], replay: ReplayKind::None, ..linear() },
    ];
    let learners = agents.each_ref().map(|config| Learner::new(config, 0));
    assert_eq!(populations(&learners)[0], [0, 2, 3, 14, 15, 16, 17]);
    let together = run(&stream, &agents);
    assert!(together[3].diverged.is_some() && together[9].diverged.is_some());
    for (agent, outcome) in agents.iter().zip(&together) {
        let alone = run(&stream, std::slice::from_ref(agent));
        assert_eq!(&alone[0], outcome, "{agent:?}");
    }
    let mut errors: Vec<f64> = together.iter().map(|outcome| whole(outcome).rmse).collect();
    errors.dedup();
    assert_eq!(errors.len(), agents.len(), "every field has an effect");
}

#[test]
fn threads_beside_it_change_nothing_about_a_run() {
    let stream = waves(200);
    let agents = [linear(), mlp()];
    let alone = run(&stream, &agents);
    std::thread::scope(|scope| {
        let runs: Vec<_> = (0..3).map(|_| scope.spawn(|| run(&stream, &agents))).collect();
        for beside in runs {
            assert_eq!(beside.join().expect("finishes"), alone);
        }
    });
}

#[test]
fn divergence_is_an_outcome() {
    let stream = waves(500);
    let agents = [AgentConfig { learning_rate: 50.0, ..linear() }, linear()];
    let outcomes = run(&stream, &agents);
    let diverged = &outcomes[0];
    let step = diverged.diverged.expect("diverges");
    assert!((16..200).contains(&step), "{step}");
    assert!(
        Part::ALL
            .iter()
            .all(|&part| diverged.scores.of(part).expect("scored").rmse == f64::INFINITY)
    );
    assert_eq!(whole(diverged).scored_steps, whole(&outcomes[1]).scored_steps);
    assert_eq!(diverged.curve.len(), step / 25);
    assert!(diverged.updates < 200);
    assert_eq!(outcomes[1].diverged, None);
    assert!(whole(&outcomes[1]).rmse.is_finite());
}

#[test]
fn extreme_learning_rates_are_harmless() {
    let stream = waves(300);
    let agents =
        [1e-40, 1e-43, 1e-6, 1.0].map(|learning_rate| AgentConfig { learning_rate, ..mlp() });
    let outcomes = run(&stream, &agents);
    // The rate is too small to move any parameter: predictions stay those of the initial network.
    assert_eq!(outcomes[0], outcomes[1]);
    assert!(whole(&outcomes[2]).rmse < whole(&outcomes[0]).rmse);
    assert!(outcomes.iter().all(|outcome| whole(outcome).rmse.is_finite()));
}

#[test]
fn a_target_copied_after_every_update_is_no_target() {
    let stream = waves(300);
    let agents = [0, 1, 1_000_000]
        .map(|target_network_period| AgentConfig { target_network_period, ..linear() });
    let outcomes = run(&stream, &agents);
    // Sums are computed in another order.
    assert!((whole(&outcomes[0]).rmse - whole(&outcomes[1]).rmse).abs() < 1e-5);
    assert!((whole(&outcomes[0]).rmse - whole(&outcomes[2]).rmse).abs() > 1e-2);
}

/// A stream of three states, the last of which is not a number.
struct Broken;

impl Stream for Broken {
    fn len(&self) -> usize {
        3
    }

    fn width(&self) -> usize {
        1
    }

    fn state(&self, t: usize) -> &[f32] {
        &[&[0.0], &[1.0], &[f32::NAN]][t][..]
    }

    fn pieces(&self) -> &[std::ops::Range<usize>] {
        std::slice::from_ref(&(0..3))
    }
}

/// Returns the message with which a training is refused.
fn refusal(stream: &RowStream, cumulant: usize, agent: AgentConfig) -> String {
    let curve = CurveRule::default();
    train(stream, cumulant, &[agent], curve, Seed::new(1), &Silent)
        .expect_err("refused")
        .to_string()
}

#[test]
fn bad_requests_are_refused() {
    let stream = waves(30);
    assert_eq!(
        refusal(&stream, 2, linear()),
        "cumulant column 2 does not exist: expected a column below 2, the width of a state"
    );
    assert!(
        refusal(&stream, 0, linear()).starts_with(
            "no step can be scored: with gamma = 0.9, scoring a prediction needs the 44"
        )
    );
    assert!(refusal(&stream, 0, AgentConfig { gamma: 1.0, ..linear() }).contains("`gamma`"));
    let curve = CurveRule::default();
    let broken = train(&Broken, 0, &[linear()], curve, Seed::new(1), &Silent);
    assert_eq!(
        broken.expect_err("refused").to_string(),
        "cumulant column 0 is NaN at step 2: expected finite states"
    );
    let empty = unbroken(vec![0.0], 1, []);
    assert!(refusal(&empty, 0, linear()).starts_with("no step can be scored"));
}

#[derive(Default)]
pub(super) struct Impatient {
    pub(super) advanced: AtomicU64,
    pub(super) patience: u64,
}

impl Monitor for Impatient {
    fn advance(&self, units: u64) {
        self.advanced.fetch_add(units, Ordering::Relaxed);
    }

    fn interrupted(&self) -> bool {
        self.advanced.load(Ordering::Relaxed) >= self.patience
    }
}

#[test]
fn the_monitor_sees_the_stream_once_and_can_stop() {
    let stream = waves(1_000);
    let agents = [linear(), mlp(), AgentConfig { gamma: 0.5, ..linear() }];
    let curve = CurveRule::default();
    let [(finished, steps), (stopped, fewer)] = [u64::MAX, 500].map(|patience| {
        let monitor = Impatient { patience, ..Impatient::default() };
        let result = train(&stream, 0, &agents, curve, Seed::new(1), &monitor);
        (result, monitor.advanced.into_inner())
    });
    assert!(finished.is_ok());
    assert_eq!(steps, 999);
    assert_eq!(stopped, Err(Cancelled.into()));
    assert!((500..600).contains(&fewer), "{fewer}");
}

/// A monitor that asks to stop after twenty checks.
struct Patience(AtomicU64);

impl Monitor for Patience {
    fn interrupted(&self) -> bool {
        self.0.fetch_add(1, Ordering::Relaxed) >= 20
    }
}

#[test]
fn a_step_of_many_updates_can_be_stopped() {
    let stream = waves(200);
    for agent in [linear(), mlp()] {
        let agents = [AgentConfig { updates_per_step: usize::MAX / 2, ..agent }];
        let curve = CurveRule { windows: 20 };
        // The monitor is checked before each of the steps that fill a mini-batch, and then within the
        // first that learns.
        let monitor = Patience(AtomicU64::new(0));
        let stopped = train(&stream, 0, &agents, curve, Seed::new(5), &monitor);
        assert!(matches!(stopped, Err(AgentError::Cancelled(_))), "{stopped:?}");
    }
}

#[test]
fn a_trace_predicts_what_the_state_alone_cannot() {
    // 1, 0, 0, 1, 0, 0, …: the successor of a 0 is a 0 or a 1, and only memory tells which.
    let values = (0..6_000).map(|t| if t % 3 == 0 { 1.0 } else { 0.0 });
    let stream = unbroken(values.collect(), 1, 0..6_000);
    let agent = AgentConfig { gamma: 0.5, learning_rate: 0.5, ..linear() };
    let agents = [agent.clone(), AgentConfig { traces: vec![0.5], ..agent }];
    let outcomes = run(&stream, &agents);
    let relative =
        |agent: usize| settled(&outcomes[agent]).rmse / settled(&outcomes[agent]).return_std;
    assert!(relative(0) > 0.3, "{:?}", outcomes[0]);
    assert!(relative(1) < 0.05, "{:?}", outcomes[1]);
}
