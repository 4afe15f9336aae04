use calib_core::Silent;

use super::*;
use crate::{
    ActionModel, ActionModelConfig, Begin, Behaviour, CartPole, Grid, Simulated,
    model::tests::built, record, trajectory,
};

pub(crate) fn small_model() -> ActionModel {
    let mut world = Simulated::new(CartPole::default(), Begin::AsTheTask);
    let recorded = record(&mut Behaviour::Random, &mut world, 600, 50, Seed::new(1));
    let log = recorded.decisions(2).expect("a log");
    let config = ActionModelConfig { members: 3, ..ActionModelConfig::default() };
    built(log, 1, &config, 0.0)
}

#[test]
fn the_same_for_any_number_of_threads() {
    let model = small_model();
    let grid = Grid { step_size: Some(vec![0.01, 0.1]), ..Grid::default() };
    let candidates = grid.candidates(AgentConfig::default()).expect("two");
    let budget = RunBudget { runs: 2, span: RunLength { steps: 400, timeout: 50 } };
    let [one, three] = [1, 3].map(|threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| sweep(&model, &candidates, budget, Seed::new(5), &Silent)).expect("run")
    });
    assert_eq!(one, three);
    assert_eq!(one.len(), 3 * 2 * 2);
    let places: Vec<_> = one.iter().map(|run| (run.member, run.run, run.candidate)).collect();
    assert!(places.is_sorted());
    assert!(one.iter().all(|run| run.coverage.steps == 400));
    assert!(one.iter().any(|run| run.curve.len() == 10));
    let true_returns = truth(
        || Simulated::new(CartPole::default(), Begin::AsTheTask),
        &candidates,
        budget,
        Seed::new(5),
        &Silent,
    )
    .expect("run");
    assert_eq!((true_returns.len(), true_returns[0].len()), (2, 2));
    assert_ne!(true_returns[0], true_returns[1]);
}

#[test]
fn whoever_interrupts_is_heard() {
    struct Impatient;
    impl Monitor for Impatient {
        fn begin(&self, _task: &str, _total: u64) {}
        fn advance(&self, _units: u64) {}
        fn interrupted(&self) -> bool {
            true
        }
    }
    let budget = RunBudget { runs: 1, span: RunLength { steps: 10, timeout: 5 } };
    let candidates = [AgentConfig::default()];
    let told = sweep(&small_model(), &candidates, budget, Seed::new(5), &Impatient);
    assert!(matches!(told, Err(ControlError::Cancelled(_))));
}

#[test]
fn tenths_are_means_in_order() {
    let returns: Vec<f64> = (0..25).map(f64::from).collect();
    let curve = tenths(&returns);
    assert_eq!(curve.len(), 10);
    assert_eq!((curve[0], curve[9]), (0.5, 23.0));
    assert!(tenths(&returns[..9]).is_empty());
}

/// Makes two runs of each of two agents in each of three ensemble members.
fn swept(model: &ActionModel, agents: &[AgentConfig], keeper: &dyn RunKeeper) -> Vec<Run> {
    let span = RunLength { steps: 200, timeout: 50 };
    let ids = runs_here(ActionModelKind::Neighbors, 3, 2, 2, keeper);
    sweep_keeping(model, &agents, ids, span, Seed::new(5), keeper, &Silent).expect("run")
}

#[test]
fn a_sweep_goes_on_from_what_was_kept() {
    use std::sync::Mutex;

    #[derive(Default)]
    struct Kept {
        runs: Mutex<Vec<Run>>,
        made: Mutex<usize>,
    }
    impl RunKeeper for Kept {
        fn known(&self, id: RunId) -> Option<Run> {
            let runs = self.runs.lock().expect("not poisoned");
            runs.iter().find(|run| run.id() == id).cloned()
        }
        fn keep(&self, run: &Run) -> Result<(), ControlError> {
            self.runs.lock().expect("not poisoned").push(run.clone());
            *self.made.lock().expect("not poisoned") += 1;
            Ok(())
        }
    }
    let model = small_model();
    let kept = Kept::default();
    let grid = Grid { step_size: Some(vec![0.01, 0.1]), ..Grid::default() };
    let candidates = grid.candidates(AgentConfig::default()).expect("two");
    let whole = swept(&model, &candidates, &NotKept);
    assert!(whole.iter().all(|run| run.drift.episodes > 0));
    assert_eq!(swept(&model, &candidates, &kept), whole);
    kept.runs.lock().expect("not poisoned").truncate(7);
    *kept.made.lock().expect("not poisoned") = 0;
    assert_eq!(swept(&model, &candidates, &kept), whole);
    assert_eq!(*kept.made.lock().expect("not poisoned"), whole.len() - 7);
}

#[test]
fn runs_of_kinds_are_divided_without_their_models() {
    /// A keeper that runs every ninth run here.
    struct Ninth;
    impl RunKeeper for Ninth {
        fn known(&self, _: RunId) -> Option<Run> {
            None
        }
        fn keep(&self, _: &Run) -> Result<(), ControlError> {
            Ok(())
        }
        fn has(&self, number: usize) -> bool {
            number % 9 == 8
        }
    }
    // Numbers 0 to 5 are runs of neighbours, 6 to 11 of increments, 12 to 17 of networks.
    let [of_neighbors, of_increments, of_network] =
        ActionModelKind::ALL.map(|kind| runs_here(kind, 3, 1, 2, &Ninth));
    assert!(of_neighbors.is_empty());
    let kind = ActionModelKind::Increments;
    assert_eq!(of_increments, [RunId { kind, member: 1, run: 0, candidate: 0 }]);
    let kind = ActionModelKind::Network;
    assert_eq!(of_network, [RunId { kind, member: 2, run: 0, candidate: 1 }]);
    assert_eq!(runs_here(kind, 3, 4, 2, &NotKept).len(), 24);
}

#[test]
fn a_trajectory_is_the_end_of_the_first_run() {
    let model = small_model();
    let grid = Grid { step_size: Some(vec![0.01, 0.1]), ..Grid::default() };
    let candidates = grid.candidates(AgentConfig::default()).expect("two");
    let span = RunLength { steps: 400, timeout: 50 };
    let budget = RunBudget { runs: 1, span };
    let runs = sweep(&model, &candidates, budget, Seed::new(5), &Silent).expect("run");
    let whole = trajectory(&model, &&candidates[..], 1, span, 400, Seed::new(5), &Silent);
    let whole = whole.expect("run");
    assert_eq!(whole.run.mean_return(), runs[1].mean_return);
    let sum = whole.run.returns.iter().sum::<f64>() + whole.run.rest;
    assert!((whole.rewards.iter().sum::<f64>() - sum).abs() < 1e-9);
    let begun = whole.begins.iter().filter(|begins| **begins).count();
    assert!(begun.abs_diff(whole.run.returns.len()) <= 1 && whole.begins[0], "{begun} episodes");
    let end = trajectory(&model, &&candidates[..], 1, span, 100, Seed::new(5), &Silent);
    let end = end.expect("run");
    assert_eq!(end.actions, whole.actions[300..]);
    assert_eq!(end.states, whole.states[300 * whole.columns..]);
    let recorded: Vec<f32> =
        end.places.iter().flat_map(|&place| model.observed(place)).copied().collect();
    assert_eq!(end.states, recorded, "every state is that of its place");
}
