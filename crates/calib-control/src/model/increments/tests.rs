use calib_core::{Seed, Segments, Silent};

use super::*;
use crate::{ActionModelConfig, Columns, Ending, Levels, Pessimism, model::tests::built};

/// Returns a log of a place that moves by −0.02 or +0.03, beside a column of noise, in
/// episodes of forty rows.
fn decisions(levels: Option<usize>) -> Decisions {
    let mut rng = Seed::new(1).rng();
    let rows = 2000;
    let mut place = 0.5_f32;
    let mut states = Vec::new();
    let mut set = Vec::new();
    let mut rewards = Vec::new();
    for row in 0..rows {
        if row % 40 == 0 {
            place = 0.2 + 0.6 * rng.unit() as f32;
        }
        states.extend([place, rng.unit() as f32]);
        rewards.push(place);
        let action = if levels.is_some() { rng.unit() } else { rng.below(2) as f64 };
        set.push(action);
        place += follows(action);
    }
    let lengths = vec![40; rows / 40];
    let segments = Segments::from_lengths(lengths).expect("valid");
    let endings = vec![Ending::Continues; rows];
    let (levels, settings) = match levels {
        None => (Levels::new(&[set], 8).expect("two"), None),
        Some(levels) => {
            let (levels, settings) = Levels::of_range(&[set], levels, 8).expect("levels");
            (levels, Some(settings))
        }
    };
    let columns = Columns { actions: &levels.of_rows, rewards: &rewards, endings: &endings };
    let states = States::new(states, rows, 2).expect("valid");
    let log = Decisions::new(states, &segments, columns, levels.values.len()).expect("a log");
    match settings {
        Some(settings) => log.with_settings(settings).expect("as many"),
        None => log,
    }
}

fn follows(action: f64) -> f32 {
    (0.05 * action - 0.02) as f32
}

fn model(levels: Option<usize>, pessimism: Pessimism) -> ActionModel {
    let config = ActionModelConfig { pessimism, members: 3, ..ActionModelConfig::DEFAULT };
    built(decisions(levels), 9, &config, -7.0)
}

fn increments(model: &ActionModel) -> Increments {
    Increments::new(model, 0.95, &Silent).expect("made")
}

#[test]
fn a_smooth_column_keeps_its_offset_and_noise_does_not() {
    let model = model(None, Pessimism::Nearest);
    let increments = increments(&model);
    assert_eq!(increments.keeps(), [true, false]);
    let ensemble = IncrementModel::new(&model, &increments);
    for member in 0..ensemble.members() {
        let mut rollout = ensemble.rollout(member);
        let mut rng = Seed::new(2).rng();
        let mut state = [0.0; 2];
        rollout.start(&mut rng, &mut state);
        assert!((0..9).any(|start| model.starts().row(start) == state));
        state[0] = 0.5;
        for action in [0, 1, 1, 0, 1] {
            let before = state[0];
            let outcome = rollout.step(action, &mut rng, &mut state);
            // The change adds to the place itself; recombined rows would lead to the place
            // of a neighbour.
            assert!((state[0] - before - follows(action as f64)).abs() < 1e-6);
            assert!((outcome.reward - f64::from(state[0])).abs() < 0.1, "{outcome:?} {state:?}");
            assert!(recorded(&model, state[1]), "noise is what was recorded");
        }
        assert_eq!(rollout.coverage().steps, 5);
    }
}

fn recorded(model: &ActionModel, noise: f32) -> bool {
    (0..model.log().states().rows()).any(|row| model.log().states().row(row)[1] == noise)
}

#[test]
fn steps_stay_in_the_range_of_the_log() {
    let model = model(None, Pessimism::Nearest);
    let increments = increments(&model);
    let ensemble = IncrementModel::new(&model, &increments);
    let mut rollout = ensemble.rollout(0);
    let mut rng = Seed::new(2).rng();
    let mut state = [0.5, 0.5];
    let highest = (0..model.log().states().rows())
        .map(|row| model.log().states().row(row)[0])
        .fold(0.0, f32::max);
    for _ in 0..200 {
        rollout.step(1, &mut rng, &mut state);
    }
    assert_eq!(state[0], highest);
}

#[test]
fn a_member_does_not_know_its_block() {
    let model = model(None, Pessimism::Nearest);
    let increments = increments(&model);
    let mut query = Vec::new();
    for member in 0..3 {
        for number in (0..model.log().len()).step_by(97) {
            let transition = TransitionIndex::new(number);
            let [source, _] = model.log().ends(transition);
            let action = usize::from(model.log().actions()[number]);
            let mut found = Nearest::new(1);
            let target = Target::Level(action);
            increments.nearest((&model, member), source, target, &mut query, &mut found);
            let (nearest, distances) = found.lists();
            let is_known = model.blocks().contains(member, transition);
            assert_eq!(nearest[0] == transition.0 && distances[0] == 0.0, is_known);
            assert!(model.blocks().contains(member, TransitionIndex(nearest[0])));
        }
    }
}

#[test]
fn an_episode_ends_where_the_log_does_not_cover_a_step_if_so_wished() {
    let model = model(None, Pessimism::MinimumReturn);
    let increments = increments(&model);
    let ensemble = IncrementModel::new(&model, &increments);
    let mut rollout = ensemble.rollout(0);
    let mut rng = Seed::new(2).rng();
    let mut state = [90.0, 0.5];
    let outcome = rollout.step(1, &mut rng, &mut state);
    assert_eq!((outcome.reward, outcome.ending), (-7.0, Ending::Terminal));
    assert_eq!((state[0], rollout.coverage().far), (90.0, 1));
}

#[test]
fn actions_that_are_numbers_move_by_what_was_set_near_the_level() {
    let model = model(Some(3), Pessimism::Nearest);
    let increments = increments(&model);
    assert!(increments.keeps()[0]);
    let ensemble = IncrementModel::new(&model, &increments);
    let mut rollout = ensemble.rollout(1);
    let mut rng = Seed::new(2).rng();
    for (action, set) in [(0, 0.0), (1, 0.5), (2, 1.0)] {
        let mut state = [0.5, 0.5];
        rollout.step(action, &mut rng, &mut state);
        assert!((state[0] - 0.5 - follows(set)).abs() < 0.01, "{action}: {state:?}");
    }
}
