//! Tests of rollouts through the public interface.

use std::collections::BTreeSet;

use calib_core::{
    Monitor, RowIndex, Seed, Segments, Silent, States, Stream as _, TransitionIndex, Transitions,
};
use calib_knn::{KnnModel, Member, ModelConfig, Weights};
use calib_model::{
    Absent, JumpStatistics, RequestedStart, Rollout, RolloutError, Start, StartSource, StartState,
    rollout, rollouts, start_states,
};
use proptest::prelude::*;

mod starts;

const LENGTHS: [usize; 4] = [150, 1, 90, 200];

fn model(config: &ModelConfig) -> KnnModel {
    let rows = LENGTHS.iter().sum();
    let mut rng = Seed::new(7).rng();
    let mut state = [0.5_f64; 3];
    let mut values = Vec::new();
    for _ in 0..rows {
        for value in &mut state {
            *value = 0.9 * *value + 0.1 * rng.unit();
            values.push(*value as f32);
        }
    }
    let states = States::new(values, rows, 3).expect("valid");
    let transitions = Transitions::new(Segments::from_lengths(LENGTHS).expect("valid"));
    KnnModel::build(states, transitions, config, &Silent).expect("built")
}

fn rows_of_member(model: &KnnModel, member: usize) -> BTreeSet<RowIndex> {
    model
        .blocks()
        .transitions_of(member)
        .flat_map(|i| [model.transitions().source(i), model.transitions().next(i)])
        .collect()
}

#[test]
fn a_rollout_never_leaves_its_member() {
    let model = model(&ModelConfig::default());
    for number in 0..model.members() {
        let member = model.member(number);
        let allowed = rows_of_member(&model, number);
        let block: BTreeSet<RowIndex> = model
            .blocks()
            .own(number)
            .flat_map(|i| {
                let i = TransitionIndex(i);
                [model.transitions().source(i), model.transitions().next(i)]
            })
            .collect();
        let starts = start_states(&member, StartSource::Random, 4, Seed::new(3)).expect("starts");
        let all = rollouts(&member, &starts, 2000, Weights::Linear, Seed::new(3), &Silent)
            .expect("rolled out");
        for rollout in &all {
            assert_eq!((rollout.steps(), rollout.rows().len()), (2000, 2001));
            assert!(rollout.rows().iter().all(|row| allowed.contains(row) && !block.contains(row)));
        }
    }
}

#[test]
fn each_step_is_drawn_from_the_table_and_emits_the_next_state() {
    let model = model(&ModelConfig { exclude_self: true, ..ModelConfig::default() });
    let member = model.member(1);
    let start =
        start_states(&member, StartSource::Random, 1, Seed::new(5)).expect("starts").remove(0);
    let Start::At(mut current) = start.start else { panic!("random starts are in the member") };
    let trajectory = rollout(&member, &start, 500, Weights::Uniform, Seed::new(6));
    assert_eq!(trajectory.rows()[0], model.transitions().next(current));
    for (&drawn, &row) in trajectory.transitions().iter().zip(&trajectory.rows()[1..]) {
        assert!(member.neighbors(current).0.contains(&drawn.0));
        assert_eq!(row, model.transitions().next(drawn));
        current = drawn;
    }
    let stream = trajectory.stream(model.states());
    assert_eq!((stream.pieces().len(), &stream.pieces()[0]), (1, &(0..501)));
    assert_eq!(stream.state(9), model.states().row(trajectory.rows()[9].get()));
}

#[test]
fn draws_from_one_state_follow_the_weights() {
    let model = model(&ModelConfig { theiler: 5, neighbors: 4, ..ModelConfig::default() });
    let member = model.member(0);
    let transition = member.nth(200);
    let wanted = RequestedStart::Recorded(model.transitions().next(transition));
    let start = StartState { start: Start::At(transition), wanted, replaced: None };
    let (neighbors, distances) = member.neighbors(transition);
    let mut counts = [0_u32; 4];
    let n = 40_000;
    for number in 0..n {
        let trajectory = rollout(&member, &start, 1, Weights::Linear, Seed::new(1).number(number));
        let drawn = trajectory.transitions()[0].0;
        counts[neighbors.iter().position(|&j| j == drawn).expect("a neighbour")] += 1;
    }
    let expected = Weights::Linear.probabilities(distances);
    let chi_square: f64 = expected
        .iter()
        .zip(counts)
        .map(|(p, count)| (f64::from(count) - p * n as f64).powi(2) / (p * n as f64))
        .sum();
    // The 0.999 quantile with 3 degrees of freedom.
    assert!(chi_square < 16.3, "chi-square {chi_square}");
}

fn bytes(rollouts: &[Rollout]) -> Vec<u32> {
    rollouts.iter().flat_map(|r| r.rows().iter().map(|row| row.0)).collect()
}

/// Returns the rows of six rollouts.
fn run(member: &Member<'_>, threads: usize, seed: u64) -> Vec<u32> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
    pool.install(|| {
        let starts = start_states(member, StartSource::Random, 6, Seed::new(seed)).expect("starts");
        let all = rollouts(member, &starts, 300, Weights::Linear, Seed::new(seed), &Silent);
        bytes(&all.expect("rolled out"))
    })
}

#[test]
fn rollouts_are_pure_functions_of_their_arguments() {
    let model = model(&ModelConfig::default());
    let once = run(&model.member(0), 1, 9);
    assert_eq!(once, run(&model.member(0), 1, 9));
    assert_eq!(once, run(&model.member(0), 4, 9));
    assert_ne!(once, run(&model.member(0), 1, 10));
    assert_ne!(once, run(&model.member(1), 1, 9));
    let few = start_states(&model.member(0), StartSource::Random, 2, Seed::new(9)).expect("starts");
    let many =
        start_states(&model.member(0), StartSource::Random, 6, Seed::new(9)).expect("starts");
    assert_eq!(few, many[..2]);
}

/// Returns the jump statistics of three rollouts of
/// a model.
fn jumps_of(config: &ModelConfig) -> JumpStatistics {
    let model = model(config);
    let member = model.member(0);
    let starts = start_states(&member, StartSource::Random, 3, Seed::new(1)).expect("starts");
    let all = rollouts(&member, &starts, 3000, Weights::Linear, Seed::new(1), &Silent)
        .expect("rolled out");
    JumpStatistics::of(all.iter().map(Rollout::rows))
}

#[test]
fn self_matches_replay_and_exclusion_jumps() {
    let single = jumps_of(&ModelConfig { neighbors: 1, ..ModelConfig::default() });
    assert!(single.jump_rate < 0.1 && single.longest_run > 50);
    let excluded = jumps_of(&ModelConfig { exclude_self: true, ..ModelConfig::default() });
    assert_eq!((excluded.jump_rate, excluded.mean_run_length), (1.0, 9003.0 / 9003.0));
}

struct Stopped;

impl Monitor for Stopped {
    fn begin(&self, task: &str, total: u64) {
        assert_eq!((task, total), ("rollouts", 200));
    }

    fn interrupted(&self) -> bool {
        true
    }
}

#[test]
fn work_ends_when_the_user_asks() {
    let model = model(&ModelConfig::default());
    let member = model.member(0);
    let starts = start_states(&member, StartSource::Random, 2, Seed::new(1)).expect("starts");
    let stopped = rollouts(&member, &starts, 100, Weights::Linear, Seed::new(1), &Stopped);
    assert!(matches!(stopped, Err(RolloutError::Cancelled(_))));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn any_row_is_a_start(rows in proptest::collection::vec(0_u32..441, 1..6), member in 0_usize..5, replace: bool) {
        thread_local!(static MODEL: KnnModel = model(&ModelConfig::default()));
        MODEL.with(|model| {
            let member = model.member(member);
            let rows: Vec<RowIndex> = rows.into_iter().map(RowIndex).collect();
            let absent = if replace { Absent::Replace } else { Absent::External };
            let source = StartSource::Rows { rows: &rows, absent };
            let starts = start_states(&member, source, rows.len(), Seed::new(0)).expect("starts");
            for (start, row) in starts.iter().zip(&rows) {
                let trajectory = rollout(&member, start, 5, Weights::Inverse, Seed::new(0));
                let rows_made = trajectory.rows();
                if start.replaced.is_none() {
                    prop_assert_eq!(rows_made[0], *row);
                } else {
                    prop_assert!(rows_of_member(model, member.number()).contains(&rows_made[0]));
                }
                prop_assert!(rows_made[1..].iter().all(|row| rows_of_member(model, member.number()).contains(row)));
            }
            Ok(())
        })?;
    }
}
