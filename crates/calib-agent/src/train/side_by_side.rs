//! Tests of learners of several sensors, with checkpoints, and of resumed runs.

use std::{cell::RefCell, sync::atomic::AtomicU64};

use calib_core::{Cancelled, Silent};
use calib_nn::Moments;

use super::{
    tests::{Impatient, linear, mlp, waves},
    *,
};
use crate::{Checkpoint, OptimiserKind, Part, Precision, ReplayKind, parameter_count};

fn run(stream: &dyn Stream) -> Run<'_> {
    let steps = stream.len() - 1;
    let curve = CurveRule { windows: 20 };
    Run { stream, steps, curve, seed: Seed::new(5) }
}

fn rmse(outcome: &RunOutcome) -> f64 {
    outcome.scores.of(Part::WholeRun).expect("scored").rmse
}

fn outcomes(stream: &dyn Stream, learners: &[Learner<'_>]) -> Vec<RunOutcome> {
    train_learners(run(stream), learners, &NoKeeper, &Silent).expect("trains")
}

/// Returns agents of every kind, one of which diverges.
fn agents() -> Vec<AgentConfig> {
    let adam = AgentConfig { optimiser: OptimiserKind::Adam, learning_rate: 1e-2, ..linear() };
    vec![
        mlp(),
        linear(),
        AgentConfig { learning_rate: 1e8, ..linear() },
        AgentConfig { learning_rate: 1e-2, ..mlp() },
        adam.clone(),
        AgentConfig { target_network_period: 7, replay_capacity: 60, ..adam },
        AgentConfig { target_network_period: 10, updates_per_step: 2, ..mlp() },
        AgentConfig { replay: ReplayKind::None, ..mlp() },
        AgentConfig { gamma: 0.5, learning_rate: 0.0, ..mlp() },
        with_traces(OptimiserKind::TrueOnlineTd),
        with_traces(OptimiserKind::SwiftTd),
        AgentConfig { learning_rate: 0.0, ..with_traces(OptimiserKind::SwiftTd) },
        rounded(),
        AgentConfig { learning_rate: 1e-2, ..rounded() },
        AgentConfig { learning_rate: 0.0, ..rounded() },
        AgentConfig { learning_rate: 1e30, ..rounded() },
        AgentConfig { target_network_period: 10, updates_per_step: 2, ..rounded() },
        AgentConfig { replay: ReplayKind::None, ..rounded() },
    ]
}

fn with_traces(optimiser: OptimiserKind) -> AgentConfig {
    AgentConfig { optimiser, replay: ReplayKind::None, ..linear() }
}

fn rounded() -> AgentConfig {
    AgentConfig { precision: Precision::Bf16, ..mlp() }
}

fn checkpoint(config: &AgentConfig, moments: bool) -> Checkpoint {
    let count = parameter_count(config, 2);
    let mut rng = Seed::new(8).rng();
    let mut draw = |low, high| (0..count).map(|_| rng.uniform(low, high) as f32).collect();
    let parameters = draw(-0.3, 0.3);
    let mean = draw(-0.1, 0.1);
    let square = draw(0.0, 0.1);
    let moments = moments.then_some(Moments { mean, square, powers: (0.5, 0.9) });
    Checkpoint { parameters, moments }
}

#[test]
fn sensors_side_by_side_are_what_they_are_alone() {
    let stream = waves(300);
    let agents = agents();
    let together: Vec<_> = [1, 0]
        .iter()
        .flat_map(|&cumulant| agents.iter().map(move |config| Learner::new(config, cumulant)))
        .collect();
    let all = outcomes(&stream, &together);
    for (learner, outcome) in together.iter().zip(&all) {
        let alone = outcomes(&stream, std::slice::from_ref(learner));
        assert_eq!(&alone[0], outcome, "{learner:?}");
    }
    assert_ne!(rmse(&all[0]), rmse(&all[agents.len()]), "sensors differ");
    assert!(all[2].diverged.is_some() && all[15].diverged.is_some());
}

#[test]
fn a_checkpoint_is_where_learning_starts() {
    let stream = waves(300);
    for kind in [mlp(), rounded(), AgentConfig { optimiser: OptimiserKind::Adam, ..linear() }] {
        let [frozen, slow, fast] =
            [0.0, 1e-12, 1e-2].map(|learning_rate| AgentConfig { learning_rate, ..kind.clone() });
        let bare = checkpoint(&kind, false);
        let whole = checkpoint(&kind, true);
        let outcome = |config, start| {
            outcomes(&stream, &[Learner { start, ..Learner::new(config, 0) }]).remove(0)
        };

        let kept = outcome(&frozen, Some(&bare));
        let moved = outcome(&slow, Some(&bare));
        assert!((rmse(&kept) - rmse(&moved)).abs() < 1e-5 * rmse(&kept), "no rate, or nearly none");
        assert_eq!(rmse(&kept), rmse(&outcome(&frozen, Some(&whole))));
        assert_ne!(rmse(&kept), rmse(&outcome(&frozen, None)));
        // Without learning, the curve repeats the stream's errors: the checkpoint never improves.
        let scratch = outcome(&fast, None);
        let [reset, keep] = [&bare, &whole].map(|start| outcome(&fast, Some(start)));
        assert_ne!(rmse(&reset), rmse(&scratch));
        assert_ne!(rmse(&reset), rmse(&keep), "moments have an effect");
        assert!(rmse(&reset) < rmse(&kept), "{reset:?} {kept:?}");
    }
}

#[test]
fn a_checkpoint_of_another_shape_is_refused() {
    let stream = waves(60);
    let config = mlp();
    let start = checkpoint(&linear(), false);
    let learner = Learner { start: Some(&start), ..Learner::new(&config, 0) };
    let error = train_learners(run(&stream), &[learner], &NoKeeper, &Silent);
    assert_eq!(
        error.expect_err("refused").to_string(),
        "the checkpoint has 3 parameters: expected 205, as many as the value function has"
    );
}

/// Stores every state in memory.
struct Memory {
    work: u64,
    states: RefCell<Vec<RunState>>,
}

impl Checkpointer for Memory {
    fn work_between(&self) -> u64 {
        self.work
    }

    fn load(&self) -> Option<RunState> {
        self.states.borrow().last().cloned()
    }

    fn keep(&self, state: RunState) -> Result<(), String> {
        // Numbers are stored as text, as in a file.
        let text = serde_json::to_string(&state.progress).expect("plain data");
        let progress = serde_json::from_str(&text).expect("reads");
        self.states.borrow_mut().push(RunState { progress, ..state });
        Ok(())
    }
}

#[test]
fn a_resumed_run_is_the_uninterrupted_one() {
    let stream = waves(300);
    let agents = agents();
    let start = checkpoint(&agents[0], true);
    let learners: Vec<_> = agents
        .iter()
        .enumerate()
        .map(|(index, config)| {
            let start = (parameter_count(config, 2) == start.parameters.len()).then_some(&start);
            Learner { start, ..Learner::new(config, index % 2) }
        })
        .collect();
    let whole = outcomes(&stream, &learners);
    let all = Memory { work: 20_000_000, states: RefCell::default() };
    let kept = train_learners(run(&stream), &learners, &all, &Silent).expect("trains");
    assert_eq!(kept, whole, "keeping changes nothing");
    let states = all.states.take();
    assert!(states.len() > 20, "{}", states.len());
    for state in states {
        let one = Memory { work: u64::MAX, states: RefCell::new(vec![state]) };
        let resumed = train_learners(run(&stream), &learners, &one, &Silent).expect("trains");
        assert_eq!(resumed, whole);
    }
}

#[test]
fn an_interrupted_run_keeps_its_state() {
    let stream = waves(1_000);
    let agents = [mlp()];
    let learners = [Learner::new(&agents[0], 0)];
    let [short, long] = [8_000_000_000, 3_000_000_000].map(|work| {
        let memory = Memory { work, states: RefCell::default() };
        let impatient = Impatient { patience: 500, advanced: AtomicU64::new(0) };
        let stopped = train_learners(run(&stream), &learners, &memory, &impatient);
        assert_eq!(stopped, Err(Cancelled.into()));
        memory
    });
    assert!(short.states.take().is_empty(), "a short run is not worth it");
    assert_eq!(long.states.borrow().len(), 1);
    let resumed = train_learners(run(&stream), &learners, &long, &Silent).expect("trains");
    assert_eq!(resumed, outcomes(&stream, &learners));
}
