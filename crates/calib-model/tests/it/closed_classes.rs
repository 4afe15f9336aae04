//! Checks the removal of traps, and the statistics of rollouts, against `NumPy` and `SciPy`:
//! `scripts/golden/closed_classes.py`.

use calib_core::{Seed, Segments, Silent, States, TransitionIndex, Transitions};
use calib_knn::{KnnModel, ModelConfig, WeightsKind, Workplace};
use calib_model::RolloutStatistics;
use serde::Deserialize;

#[derive(Deserialize)]
struct Case {
    name: String,
    lengths: Vec<usize>,
    states: Vec<Vec<f32>>,
    members: usize,
    neighbors: usize,
    theiler: u32,
    weights: WeightsKind,
    /// The neighbours of each transition whose position in the member is a multiple of this are known.
    shown_every: usize,
    expected: Vec<Expected>,
}

#[derive(Deserialize)]
struct Expected {
    before: Vec<usize>,
    after: Vec<usize>,
    left_out: Vec<u32>,
    lost: usize,
    /// Neighbours of the shown transitions of the member, in order.
    neighbors: Vec<Vec<u32>>,
    steps_to_end: f64,
    /// Standard deviation over the steps of one rollout.
    deviation: f64,
    effective_rows: f64,
}

impl Case {
    fn all() -> Vec<Self> {
        serde_json::from_str(include_str!("../golden/closed_classes.json"))
            .expect("the golden file")
    }

    fn config(&self) -> ModelConfig {
        let Self { members, neighbors, theiler, weights, .. } = *self;
        ModelConfig { members, neighbors, theiler, weights, ..ModelConfig::default() }
    }

    fn build(&self) -> (KnnModel, calib_knn::Built) {
        let states = States::new(self.states.concat(), self.states.len(), self.states[0].len());
        let segments = Segments::from_lengths(self.lengths.iter().copied());
        let transitions = Transitions::new(segments.expect("valid"));
        let place = Workplace::default();
        KnnModel::build_in(states.expect("finite"), transitions, &self.config(), &place, &Silent)
            .expect("built")
    }
}

#[test]
fn closed_classes_and_tables_are_those_of_scipy() {
    let mut trapped = 0;
    for case in Case::all() {
        let (model, built) = case.build();
        for (number, expected) in case.expected.iter().enumerate() {
            let name = format!("{} {number}", case.name);
            let found = &built.recurrence[number];
            assert_eq!(found.before.largest, expected.before, "{name}");
            assert_eq!(found.after.largest, expected.after, "{name}");
            assert_eq!((found.lost, found.exits), (expected.lost, 0), "{name}");
            let left_out: Vec<u32> = model.left_out(number).runs().flatten().collect();
            assert_eq!(left_out, expected.left_out, "{name}");
            let member = model.member(number);
            let shown = member.len().div_ceil(case.shown_every);
            assert_eq!(expected.neighbors.len(), shown, "{name}: every shown transition has a row");
            for (shown, row) in expected.neighbors.iter().enumerate() {
                let position = shown * case.shown_every;
                assert_eq!(member.neighbors(member.nth(position)).0, row, "{name}, row {position}");
            }
            assert!(left_out.iter().all(|&node| member.contains(TransitionIndex(node))));
            trapped += usize::from(found.before.traps > 0);
        }
    }
    assert!(trapped > 5, "the cases have traps: {trapped}");
}

fn mean(values: impl ExactSizeIterator<Item = Option<f64>>) -> f64 {
    let count = values.len() as f64;
    values.map(|value| value.expect("a value")).sum::<f64>() / count
}

#[test]
fn statistics_of_rollouts_estimate_what_linear_algebra_says() {
    // Many times 32 rollouts, so that the remaining deviation is the error of the estimate.
    const TIMES: u64 = 16;
    for case in Case::all() {
        let weights = case.config().weights().expect("valid");
        let (model, built) = case.build();
        for (number, expected) in case.expected.iter().enumerate() {
            let found: Vec<RolloutStatistics> = (0..TIMES)
                .map(|time: u64| {
                    let seed = Seed::new(5).number(time);
                    RolloutStatistics::of(&model.member(number), &built.ends[number], weights, seed)
                })
                .collect();
            let few = expected.after.iter().any(|&size| size < 200);
            assert!(few || found.iter().all(|statistics| statistics.trapped == 0));
            let name = format!("{} {number}", case.name);
            let steps = mean(found.iter().map(|statistics| statistics.steps_to_end));
            let far = (steps - expected.steps_to_end).abs();
            let error = expected.deviation / f64::from(32 * TIMES as u32).sqrt();
            assert!(far <= 4.0 * error, "{name}: {steps} steps, a standard error of {error}");
            // Two separate classes are visited according to the start states of the 32 rollouts.
            if expected.after.len() == 1 {
                let rows = mean(found.iter().map(|statistics| statistics.effective_rows));
                assert!((rows / expected.effective_rows - 1.0).abs() < 0.02, "{name}: {rows} rows");
            }
        }
    }
}
