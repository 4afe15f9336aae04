use calib_core::Silent;

use super::*;
use crate::{
    ActionModel, ActionModelConfig, Begin, Behaviour, CartPole, Grid, Simulated, Starts, record,
};

pub(crate) fn small_model() -> ActionModel {
    let mut world = Simulated::new(CartPole::default(), Begin::AsTheTask);
    let recorded = record(&mut Behaviour::Random, &mut world, 600, 50, Seed::new(1));
    let log = recorded.decisions(2).expect("a log");
    let metric = log.states().clone();
    let starts = Starts { observed: metric.slice(0..1), metric: metric.slice(0..1) };
    let config = ActionModelConfig { members: 3, ..ActionModelConfig::default() };
    ActionModel::build(log, &metric, starts, &config, 0.0, &Silent).expect("built")
}

#[test]
fn the_same_for_any_number_of_threads() {
    let model = small_model();
    let grid = Grid { step_size: Some(vec![0.01, 0.1]), ..Grid::default() };
    let candidates = grid.candidates(AgentConfig::default()).expect("two");
    let extent = Extent { runs: 2, span: Span { steps: 400, timeout: 50 } };
    let of = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| sweep(&model, &candidates, extent, Seed::new(5), &Silent)).expect("run")
    };
    let one = of(1);
    assert_eq!(one, of(3));
    assert_eq!(one.len(), 3 * 2 * 2);
    let places: Vec<_> = one.iter().map(|of| (of.member, of.run, of.candidate)).collect();
    assert!(places.is_sorted());
    assert!(one.iter().all(|run| run.coverage.steps == 400));
    assert!(one.iter().any(|run| run.curve.len() == 10));
    let worlds = || Simulated::new(CartPole::default(), Begin::AsTheTask);
    let true_returns = truth(worlds, &candidates, extent, Seed::new(5), &Silent).expect("run");
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
    let extent = Extent { runs: 1, span: Span { steps: 10, timeout: 5 } };
    let candidates = [AgentConfig::default()];
    let told = sweep(&small_model(), &candidates, extent, Seed::new(5), &Impatient);
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
