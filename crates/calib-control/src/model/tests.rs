use calib_core::{Seed, Segments, Silent};
use proptest::prelude::*;

use super::*;
use crate::{Columns, ControlError, Ending, Environment};

/// Returns a log of `rows` rows, two columns and three actions, in episodes of seven rows.
fn log(rows: usize, seed: u64, actions: usize) -> Decisions {
    let mut rng = Seed::new(seed).rng();
    let states: Vec<f32> = (0..2 * rows).map(|_| rng.below(40) as f32 / 40.0).collect();
    let acted: Vec<Option<u16>> = (0..rows).map(|_| Some(rng.below(actions) as u16)).collect();
    let rewards: Vec<f32> = (0..rows).map(|row| row as f32).collect();
    let endings: Vec<Ending> = (0..rows).map(|row| Ending::terminal_if(row % 7 == 6)).collect();
    let columns = Columns { actions: &acted, rewards: &rewards, endings: &endings };
    let states = States::new(states, rows, 2).expect("valid");
    let segments = Segments::from_lengths([rows]).expect("valid");
    Decisions::new(states, &segments, columns, 3).expect("valid")
}

/// Builds the model of a log with distances between its states. Episodes begin in its first `starts` rows.
pub(crate) fn built(
    log: Decisions,
    starts: usize,
    config: &ActionModelConfig,
    worst_return: f64,
) -> ActionModel {
    try_to_build(log, starts, config, worst_return).expect("built")
}

/// Builds a model as [`built`] does, and returns the error if that fails.
fn try_to_build(
    log: Decisions,
    starts: usize,
    config: &ActionModelConfig,
    worst_return: f64,
) -> Result<ActionModel, ControlError> {
    let metric = log.states().clone();
    let starts = Starts { observed: metric.slice(0..starts), metric: metric.slice(0..starts) };
    ActionModel::build(log, &metric, starts, config, worst_return, &Silent)
}

fn model(log: Decisions, config: ActionModelConfig) -> ActionModel {
    built(log, 5, &config, -99.0)
}

#[test]
fn a_log_of_fewer_transitions_than_members_names_the_key() {
    let config = ActionModelConfig { members: 50, ..ActionModelConfig::default() };
    let few = try_to_build(log(6, 1, 2), 1, &config, -99.0).expect_err("few");
    let told = few.to_string();
    assert!(told.contains("cannot be split into 50 blocks"), "{told}");
    assert!(told.ends_with("lower control.model.members"), "{told}");
}

#[test]
fn states_beyond_the_recorded_range_are_not_covered() {
    for log_of_model in [log(400, 1, 3), continuous(400, 1).0] {
        let model = model(log_of_model, ActionModelConfig::default());
        let uncovered =
            |states: &States| model.uncovered_share(states, &Silent).expect("as many columns");
        let alike = log(200, 2, 3);
        let share = uncovered(alike.states());
        assert!(share < 0.1, "{share}");
        let moved: Vec<f32> = alike.states().as_slice().iter().map(|value| value + 2.0).collect();
        let moved = States::new(moved, 200, 2).expect("finite");
        assert_eq!(uncovered(&moved), 1.0);
        let values = [moved.as_slice(), alike.states().as_slice()].concat();
        let both = States::new(values, 400, 2).expect("finite");
        let of_both = uncovered(&both);
        assert!((of_both - f64::midpoint(1.0, share)).abs() < 1e-9, "{of_both} {share}");
        let other_columns = States::new(vec![0.5; 4], 4, 1).expect("finite");
        assert!(model.uncovered_share(&other_columns, &Silent).is_err());
    }
}

/// Computes a squared distance by the definition.
fn squared(model: &ActionModel, from: &[f32], transition: u32) -> f64 {
    let row = model.log().transitions().sources()[transition as usize] as usize;
    let state = model.log().states().row(row);
    from.iter().zip(state).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum::<f64>()
}

/// Computes a list of neighbours by the definition.
fn plain(model: &ActionModel, member: usize, from: &[f32], action: usize) -> Vec<u32> {
    let mut all: Vec<u32> = model.log().with_action(action);
    all.retain(|&candidate| model.blocks().contains(member, TransitionIndex(candidate)));
    all.sort_by(|&a, &b| {
        let [to_a, to_b] = [a, b].map(|transition| squared(model, from, transition));
        to_a.total_cmp(&to_b).then(a.cmp(&b))
    });
    all.truncate(3);
    all
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn tables_are_the_nearest_with_the_action(rows in 40_usize..400, seed in 0_u64..1000) {
        let model = model(log(rows, seed, 3), ActionModelConfig::default());
        for member in 0..model.members() {
            for action in 0..3 {
                for start in 0..5 {
                    let expected = plain(&model, member, model.starts().row(start), action);
                    prop_assert_eq!(model.start_tables[member].list(start, action).0, expected);
                }
                for number in 0..model.log().len() {
                    let transition = TransitionIndex::new(number);
                    let (got, distances) = model.tables[member].list(number, action);
                    if !model.blocks().contains(member, transition) {
                        prop_assert!(got.is_empty());
                        continue;
                    }
                    let next = model.log().transitions().next(transition).get();
                    let from = model.log().states().row(next);
                    prop_assert_eq!(got, plain(&model, member, from, action));
                    let exact = got.iter().map(|&near| squared(&model, from, near).sqrt() as f32);
                    prop_assert_eq!(distances, exact.collect::<Vec<_>>());
                }
            }
        }
    }

    #[test]
    fn the_radius_is_a_quantile_of_distances_to_other_blocks(
        rows in 40_usize..400, seed in 0_u64..1000, actions in 1_usize..4,
    ) {
        let model = model(log(rows, seed, actions), ActionModelConfig::default());
        let log = model.log();
        let each = (0..log.len()).filter_map(|number| {
            let transition = TransitionIndex::new(number);
            let [from, _] = log.ends(transition);
            let member = model.blocks().block_of(transition);
            let action = usize::from(log.actions()[number]);
            let nearest = *plain(&model, member, from, action).first()?;
            Some(f64::from(squared(&model, from, nearest).sqrt() as f32))
        });
        let distances: Vec<f64> = each.collect();
        let radius = calib_stats::quantile(&distances, 0.95).expect("some");
        prop_assert_eq!(model.radius(), radius as f32);
    }
}

/// Returns the same log with torques between levels.
fn continuous(rows: usize, seed: u64) -> (Decisions, Vec<f64>) {
    let log = log(rows, seed, 3);
    let mut rng = Seed::new(seed + 1).rng();
    let torque: Vec<f64> = (0..rows).map(|_| f64::from(rng.below(9) as u32) / 4.0 - 1.0).collect();
    let (levels, settings) =
        crate::Levels::of_range(std::slice::from_ref(&torque), 3, 64).expect("levels");
    assert_eq!(levels.values, [[-1.0], [0.0], [1.0]]);
    (log.with_settings(settings).expect("as many rows"), torque)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn tables_of_levels_are_the_nearest_in_state_and_action(
        rows in 40_usize..300, seed in 0_u64..1000, weight in 0.1_f64..5.0,
    ) {
        let (log, torque) = continuous(rows, seed);
        let config = ActionModelConfig { action_weight: weight, ..ActionModelConfig::default() };
        let model = model(log, config);
        let log = model.log();
        for member in 0..model.members() {
            for level in 0..3 {
                let wanted = (level as f64 - 1.0) / 2.0;
                for number in 0..log.len() {
                    let transition = TransitionIndex::new(number);
                    if !model.blocks().contains(member, transition) {
                        continue;
                    }
                    let from = log.states().row(log.transitions().next(transition).get());
                    let distance = |candidate: u32| {
                        let row = log.transitions().sources()[candidate as usize] as usize;
                        let state = log.states().row(row);
                        let apart = from.iter().zip(state).map(|(a, b)| f64::from(a - b).powi(2));
                        let set = weight * (torque[row] / 2.0 - wanted);
                        (apart.sum::<f64>() + set * set).sqrt()
                    };
                    let (got, distances) = model.tables[member].list(number, level);
                    let all = (0..log.len() as u32)
                        .filter(|&candidate| model.blocks().contains(member, TransitionIndex(candidate)));
                    let mut expected: Vec<f64> = all.map(distance).collect();
                    expected.sort_by(f64::total_cmp);
                    prop_assert_eq!(got.len(), 3);
                    for ((&neighbor, &told), expected) in got.iter().zip(distances).zip(expected) {
                        prop_assert!((distance(neighbor) - expected).abs() < 1e-5, "{} {}", neighbor, expected);
                        prop_assert!((f64::from(told) - expected).abs() < 1e-5);
                    }
                }
            }
        }
    }
}

/// Returns the mean distance between the torque that was asked for and that of the drawn transition, for this weight
/// of actions.
fn mean_miss(weight: f64) -> f64 {
    let (log, torque) = continuous(400, 3);
    let config = ActionModelConfig { action_weight: weight, ..ActionModelConfig::default() };
    let model = model(log, config);
    let mut rollout = model.rollout(0);
    let mut rng = Seed::new(3).rng();
    let mut state = [0.0; 2];
    let mut sum = 0.0;
    rollout.start(&mut rng, &mut state);
    for step in 0..600 {
        let outcome = rollout.step(step % 3, &mut rng, &mut state);
        // The reward is the number of the row that a transition leads to.
        let set = torque[outcome.reward as usize - 1];
        sum += (set - (step % 3) as f64 + 1.0).abs() / 600.0;
        if outcome.ending == Ending::Terminal {
            rollout.start(&mut rng, &mut state);
        }
    }
    assert_eq!(rollout.coverage().missing, 0);
    sum
}

#[test]
fn what_was_set_counts_by_its_weight() {
    let [light, even, heavy] = [0.01, 1.0, 100.0].map(mean_miss);
    assert!(light > 0.6 && even < 0.3 && heavy < 0.01, "{light} {even} {heavy}");
}

#[test]
fn a_rollout_recombines_recorded_transitions_and_counts_what_it_lacks() {
    // Action 2 does not occur in the log.
    let model = model(log(300, 1, 2), ActionModelConfig::default());
    let mut rollout = model.rollout(1);
    let mut rng = Seed::new(3).rng();
    let mut state = [0.0; 2];
    rollout.start(&mut rng, &mut state);
    for _ in 0..500 {
        let outcome = rollout.step(rng.below(2), &mut rng, &mut state);
        // The reward of a transition is the number of the row that it leads to.
        let row = outcome.reward as usize;
        assert_eq!(model.log().states().row(row), state);
        assert_eq!(outcome.ending, Ending::terminal_if(row % 7 == 6));
        if outcome.ending == Ending::Terminal {
            rollout.start(&mut rng, &mut state);
        }
    }
    assert_eq!((rollout.coverage().steps, rollout.coverage().missing), (500, 0));
    let covered = model.covered();
    assert!(covered[0] > 0.5 && covered[1] > 0.5 && covered[2] == 0.0, "{covered:?}");
    let lacking = rollout.step(2, &mut rng, &mut state);
    assert_eq!((lacking.reward, lacking.ending), (-99.0, Ending::Terminal));
    assert_eq!(rollout.coverage().missing, 1);
}

/// Returns, for 400 steps of a rollout, the number of far steps, and of those with the worst return.
fn far_and_worst_steps(config: ActionModelConfig) -> (u64, u64) {
    let model = model(log(300, 5, 3), config);
    let mut rollout = model.rollout(0);
    let mut rng = Seed::new(3).rng();
    let mut state = [0.0; 2];
    let mut worst = 0;
    rollout.start(&mut rng, &mut state);
    for _ in 0..400 {
        let outcome = rollout.step(rng.below(3), &mut rng, &mut state);
        worst += u64::from(outcome.reward == -99.0);
        if outcome.ending == Ending::Terminal {
            rollout.start(&mut rng, &mut state);
        }
    }
    (rollout.coverage().far, worst)
}

#[test]
fn what_is_far_ends_an_episode_if_that_is_asked_for() {
    let wanted = ActionModelConfig { coverage: 0.5, ..ActionModelConfig::default() };
    let strict = ActionModelConfig { pessimism: Pessimism::MinimumReturn, ..wanted };
    let (counted, ended) = far_and_worst_steps(wanted);
    assert!(counted > 20 && ended == 0, "{counted} {ended}");
    let (counted, ended) = far_and_worst_steps(strict);
    assert!(counted > 20 && ended == counted, "{counted} {ended}");
}

#[test]
fn half_of_the_recorded_states_lie_within_the_median_radius() {
    let model = model(log(400, 9, 3), ActionModelConfig { coverage: 0.5, ..Default::default() });
    let mut within = 0;
    let log = model.log();
    for number in 0..log.len() {
        let transition = TransitionIndex::new(number);
        let member = model.blocks().block_of(transition);
        let from = log.states().row(log.transitions().source(transition).get());
        let nearest = plain(&model, member, from, usize::from(log.actions()[number]))[0];
        let row = log.transitions().sources()[nearest as usize] as usize;
        let to = log.states().row(row);
        let distance = (from[0] - to[0]).hypot(from[1] - to[1]);
        within += usize::from(distance <= model.radius() * 1.000_01);
    }
    let share = within as f64 / log.len() as f64;
    assert!((0.5..0.65).contains(&share), "{share}: values are on a grid, so many are alike");
}

#[test]
fn impossible_models_are_refused() {
    let tried = |starts: usize, config: ActionModelConfig| {
        try_to_build(log(60, 1, 3), starts, &config, 0.0)
    };
    assert!(tried(1, ActionModelConfig::default()).is_ok());
    assert!(matches!(tried(0, ActionModelConfig::default()), Err(ControlError::NoStarts)));
    let none = ActionModelConfig { neighbors: 0, ..Default::default() };
    assert!(tried(1, none).expect_err("none").to_string().contains("neighbors"));
}

fn with_neighbors(neighbors: usize) -> ActionModelConfig {
    ActionModelConfig { neighbors, ..Default::default() }
}

#[test]
fn more_neighbours_than_there_are_take_no_more_memory() {
    let log = log(60, 1, 3);
    let all = ActionModel::build_bytes(&log, 1, &with_neighbors(log.len()));
    assert_eq!(ActionModel::build_bytes(&log, 1, &with_neighbors(usize::MAX)), all);
    built(log, 1, &with_neighbors(usize::MAX), 0.0);
}

/// Calls `op` on a pool of this many threads.
fn on_threads<T: Send>(threads: usize, op: impl FnOnce() -> T + Send) -> T {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
    pool.install(op)
}

#[test]
fn every_number_of_threads_gives_the_same_tables() {
    let [one, four] = [1, 4].map(|threads| {
        on_threads(threads, || model(log(9_001, 4, 3), ActionModelConfig::default()))
    });
    let queries = one.log().len();
    assert!((3 * 2_048..4 * 2_048).contains(&queries), "{queries}: three parts, and one");
    assert_eq!(one.radius(), four.radius());
    let pairs = [(&one.tables, &four.tables), (&one.start_tables, &four.start_tables)];
    for (one, four) in pairs {
        assert_eq!(one.len(), four.len());
        for (one, four) in one.iter().zip(four) {
            assert_eq!(one.neighbors(), four.neighbors());
            assert_eq!(one.distances(), four.distances());
        }
    }
}

/// Returns the memory of the lists that one search finds on so many threads.
fn bytes_of_lists(log: &Decisions, config: &ActionModelConfig, threads: usize) -> u64 {
    on_threads(threads, || {
        ActionModel::build_bytes(log, 5, config) - ActionModel::bytes(log, 5, config)
    })
}

#[test]
fn memory_includes_the_lists_of_one_search() {
    let config = ActionModelConfig { members: 2, neighbors: 3, ..Default::default() };
    let log = log(14_001, 1, 3);
    let queries = log.len() as u64;
    // Two members have three neighbours of eight bytes for each action.
    let list = 2 * 3 * 8;
    assert_eq!(ActionModel::bytes(&log, 5, &config), (queries + 5) * 3 * list);
    // A third of the queries, then 2,048 per thread, then all.
    assert_eq!(
        [1, 4, 16].map(|threads| bytes_of_lists(&log, &config, threads)),
        [queries.div_ceil(3), 4 * 2_048, queries].map(|queries| queries * 3 * list)
    );
    let (continuous, _) = continuous(60, 1);
    let queries = continuous.len() as u64;
    assert_eq!(bytes_of_lists(&continuous, &config, 16), queries * list, "one level at a time");
}
