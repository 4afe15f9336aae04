//! Tests that agents that libtorch trains side by side give the same results as native agents
//! trained alone.

use calib_agent::{
    AgentConfig, AgentError, Checkpoint, CurveRule, Learner, NoKeeper, OptimiserKind, Part,
    Precision, ReplayKind, Run, RunOutcome, ValueFunction, parameter_count, runs_together,
    train_learners, train_together,
};
use calib_core::{Cancelled, Monitor, RowStream, Seed, Segments, Silent, States, Stream};
use calib_nn::Moments;
use calib_torch::{DeviceChoice, Populations, device};

/// Tolerance for the errors of runs that are far from divergence. Both round to 24 bits, each in
/// its own order.
const TOLERANCE: f64 = 2e-5;
/// Tolerance for the errors over a few steps.
const CURVE: f64 = 2e-4;

/// Returns populations on a GPU if there is one.
fn populations() -> Populations {
    Populations::new(device(DeviceChoice::Auto).expect("always something"))
}

/// Returns a stream of three columns of waves and noise, in segments of these lengths.
fn waves(seed: u64, pieces: &[usize]) -> RowStream {
    let mut rng = Seed::new(seed).rng();
    let rows: usize = pieces.iter().sum();
    let mut values = Vec::new();
    for row in 0..rows {
        for column in 0..3 {
            let wave = (row as f64 * 0.2 * (1.0 + 0.4 * f64::from(column))).sin();
            values.push((0.5 + 0.4 * wave + 0.05 * rng.normal()) as f32);
        }
    }
    let states = States::new(values, rows, 3).expect("finite");
    RowStream::replay(states, &Segments::from_lengths(pieces.iter().copied()).expect("valid"))
}

fn network() -> AgentConfig {
    AgentConfig {
        hidden_units: 24,
        gamma: 0.8,
        batch_size: 16,
        learning_rate: 3e-3,
        ..AgentConfig::default()
    }
}

fn sgd(learning_rate: f64) -> AgentConfig {
    AgentConfig { optimiser: OptimiserKind::Sgd, learning_rate, ..network() }
}

/// Returns agents of every kind that an accelerator trains.
fn agents() -> Vec<AgentConfig> {
    let sgd = sgd(0.03);
    vec![
        network(),
        AgentConfig { learning_rate: 1e-4, beta1: 0.5, beta2: 0.99, epsilon: 1e-3, ..network() },
        AgentConfig { weight_decay: 0.3, ..network() },
        AgentConfig { learning_rate: 0.0, ..network() },
        sgd.clone(),
        AgentConfig { weight_decay: 0.5, hidden_layers: 1, ..sgd.clone() },
        AgentConfig { target_network_period: 7, ..network() },
        AgentConfig { target_network_period: 20, learning_rate: 1e-2, ..network() },
        AgentConfig { updates_per_step: 3, replay_capacity: 60, ..network() },
        AgentConfig { replay: ReplayKind::None, ..sgd },
        AgentConfig { traces: vec![0.5, 0.9], hidden_units: 9, hidden_layers: 3, ..network() },
    ]
}

/// Returns a learner for each agent.
fn learners(agents: &[AgentConfig], cumulant: usize) -> Vec<Learner<'_>> {
    agents.iter().map(|config| Learner::new(config, cumulant)).collect()
}

fn run(stream: &dyn Stream, steps: usize, seed: u64) -> Run<'_> {
    Run { stream, steps, curve: CurveRule { windows: 12 }, seed: Seed::new(seed) }
}

fn alone(run: Run<'_>, learners: &[Learner<'_>]) -> Vec<RunOutcome> {
    train_learners(run, learners, &NoKeeper, &Silent).expect("trains")
}

fn trained_together(runs: &[Run<'_>], learners: &[Learner<'_>]) -> Vec<Vec<RunOutcome>> {
    train_together(runs, learners, &populations(), &Silent).expect("trains")
}

fn assert_close(what: &str, native: &RunOutcome, torch: &RunOutcome) {
    assert_eq!((native.steps, native.updates), (torch.steps, torch.updates), "{what}");
    assert_eq!(native.diverged, torch.diverged, "{what}");
    for part in Part::ALL {
        let a = native.scores.of(part);
        let b = torch.scores.of(part);
        let (Some(a), Some(b)) = (a, b) else { panic!("{what}: {a:?} and {b:?}") };
        assert_eq!((a.scored_steps, a.mean_return), (b.scored_steps, b.mean_return), "{what}");
        assert!((a.rmse - b.rmse).abs() <= TOLERANCE * a.rmse, "{what}: {a:?} and {b:?}");
    }
    assert_eq!(native.curve.len(), torch.curve.len(), "{what}");
    for (a, b) in native.curve.iter().zip(&torch.curve) {
        assert_eq!(a.step, b.step, "{what}");
        assert!((a.rmse - b.rmse).abs() <= CURVE * a.rmse, "{what}: {a:?} and {b:?}");
    }
}

fn rmse(outcome: &RunOutcome) -> f64 {
    outcome.scores.of(Part::WholeRun).expect("scored").rmse
}

#[test]
fn runs_side_by_side_are_what_they_are_alone() {
    // Streams with different lengths and segments. One ends before the others.
    let streams = [waves(1, &[150, 90]), waves(2, &[240]), waves(3, &[60, 100, 40])];
    let runs = [run(&streams[0], 200, 1), run(&streams[1], 220, 2), run(&streams[2], 180, 3)];
    let agents = agents();
    let learners = [learners(&agents, 0), learners(&agents, 2)].concat();
    let together = trained_together(&runs, &learners);
    for (number, (run, outcomes)) in runs.iter().zip(&together).enumerate() {
        for ((learner, native), torch) in learners.iter().zip(alone(*run, &learners)).zip(outcomes)
        {
            assert_close(&format!("run {number}, {learner:?}"), &native, torch);
        }
    }
    assert_ne!(rmse(&together[0][0]), rmse(&together[1][0]), "runs differ");
    assert_ne!(rmse(&together[0][0]), rmse(&together[0][1]), "agents differ");
}

#[test]
fn a_checkpoint_is_where_learning_starts() {
    let stream = waves(4, &[200]);
    let configs = [network(), AgentConfig { target_network_period: 9, ..network() }];
    let count = parameter_count(&network(), 3);
    let mut rng = Seed::new(8).rng();
    let bounds = [(-0.3, 0.3), (-0.01, 0.01), (1e-4, 1e-3)];
    let [parameters, mean, square] = bounds.map(|(low, high)| -> Vec<f32> {
        (0..count).map(|_| rng.uniform(low, high) as f32).collect()
    });
    let bare = Checkpoint { parameters, moments: None };
    let moments = Moments { mean, square, powers: (0.5, 0.9) };
    let whole = Checkpoint { moments: Some(moments), ..bare.clone() };
    let learners: Vec<_> = configs
        .iter()
        .flat_map(|config| {
            [None, Some(&bare), Some(&whole)]
                .map(|start| Learner { start, ..Learner::new(config, 1) })
        })
        .collect();
    let run = run(&stream, 190, 5);
    let torch = trained_together(&[run], &learners);
    for (number, (native, torch)) in alone(run, &learners).iter().zip(&torch[0]).enumerate() {
        assert_close(&format!("learner {number}"), native, torch);
    }
}

#[test]
fn what_diverges_does_so_at_about_the_same_step_and_alone() {
    let stream = waves(5, &[200]);
    let agents = [sgd(1e8), sgd(0.01), sgd(30.0)];
    let learners = learners(&agents, 0);
    let run = run(&stream, 190, 6);
    let torch = trained_together(&[run], &learners);
    let native = alone(run, &learners);
    for (native, torch) in native.iter().zip(&torch[0]) {
        let steps = [native, torch].map(|outcome| outcome.diverged.unwrap_or(190) as f64);
        assert!((steps[0] - steps[1]).abs() <= 3.0, "{steps:?}");
    }
    assert!(native[0].diverged.is_some() && native[2].diverged.is_some());
    assert_close("the one that learns", &native[1], &torch[0][1]);
    assert_eq!(rmse(&torch[0][0]), f64::INFINITY);
}

#[test]
fn who_does_not_learn_does_not_diverge() {
    let values = (0..300).flat_map(|row| [1e25_f32, (row % 7) as f32, 0.0]).collect();
    let states = States::new(values, 300, 3).expect("finite");
    let stream = RowStream::replay(states, &Segments::from_lengths([300]).expect("one"));
    let frozen = AgentConfig { learning_rate: 0.0, ..network() };
    let learners = [Learner::new(&frozen, 1)];
    let run = run(&stream, 250, 7);
    let torch = trained_together(&[run], &learners);
    assert_eq!((torch[0][0].diverged, alone(run, &learners)[0].diverged), (None, None));
}

#[test]
fn a_network_does_not_depend_on_its_company() {
    let streams = [waves(1, &[200]), waves(2, &[200]), waves(3, &[200])];
    let runs = [1, 2, 3].map(|seed| run(&streams[seed - 1], 190, seed as u64));
    let agents = agents();
    let learners = learners(&agents, 1);
    let all = trained_together(&runs, &learners);
    for (number, run) in runs.iter().enumerate() {
        assert!(trained_together(&[*run], &learners)[0] == all[number], "other runs beside it");
        for (place, learner) in learners.iter().enumerate() {
            let own = &trained_together(&[*run], &[*learner])[0][0];
            assert!(own == &all[number][place], "learner {place}: other learners beside it");
        }
    }
}

#[test]
fn more_runs_than_fit_are_fewer_side_by_side() {
    let agents = agents();
    let learners = learners(&agents, 0);
    let processor = Populations::new(device(DeviceChoice::Cpu).expect("always there"));
    assert_eq!(runs_together(&processor, &learners, (200, 3)), 64);
    let few = runs_together(&processor, &learners, (1 << 40, 3));
    assert_eq!(few, 1, "one is always tried");
    let fit = runs_together(&processor, &learners, (400_000, 3));
    assert!((2..64).contains(&fit), "{fit}");
}

#[test]
fn what_no_accelerator_trains_is_refused() {
    let stream = waves(6, &[100]);
    let train = |config: &AgentConfig, monitor: &dyn Monitor| {
        train_together(&[run(&stream, 90, 1)], &[Learner::new(config, 0)], &populations(), monitor)
    };
    let linear = AgentConfig { value_function: ValueFunction::Linear, ..network() };
    let error = train(&linear, &Silent).expect_err("refused").to_string();
    assert_eq!(
        error,
        "agents with value_function = \"linear\" are not trained side by side; leave --device out"
    );
    let rounded = AgentConfig { precision: Precision::Bf16, ..network() };
    assert!(matches!(train(&rounded, &Silent), Err(AgentError::NotAccelerated(_))));
    let long = run(&stream, 100, 1);
    let config = network();
    let learner = Learner::new(&config, 0);
    let error = train_together(&[long], &[learner], &populations(), &Silent);
    assert!(matches!(error, Err(AgentError::ShortStream { .. })));
    assert_eq!(train(&network(), &Stopped), Err(Cancelled.into()));
    let narrow = States::new(vec![0.0; 200], 100, 2).expect("finite");
    let narrow = RowStream::replay(narrow, &Segments::from_lengths([100]).expect("one"));
    let runs = [run(&stream, 90, 1), run(&narrow, 90, 1)];
    let error = train_together(&runs, &[learner], &populations(), &Silent);
    assert_eq!(error, Err(AgentError::Widths { got: 2, expected: 3 }));
}

/// A monitor that always interrupts.
struct Stopped;

impl Monitor for Stopped {
    fn begin(&self, _: &str, _: u64) {}

    fn advance(&self, _: u64) {}

    fn interrupted(&self) -> bool {
        true
    }
}
