use calib_core::{Seed, Segments};
use serde::Deserialize;

use super::*;
use crate::{Behaviour, ControlConfig, Ending, Environment, Quality, RewardColumns, record};

#[derive(Deserialize)]
struct Golden {
    acrobot: Vec<Step>,
    cart_pole: Vec<Step>,
    pendulum: Vec<Step>,
    puddle_world: Vec<Step>,
}

#[derive(Deserialize)]
struct Step {
    state: Vec<f64>,
    action: f64,
    observed: Vec<f64>,
    reward: f64,
    terminal: bool,
    next: Vec<f64>,
}

fn golden() -> Golden {
    serde_json::from_str(include_str!("../../tests/golden/tasks.json")).expect("valid")
}

fn close(got: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(got.len(), expected.len());
    for (got, expected) in got.iter().zip(expected) {
        assert!((got - expected).abs() <= tolerance, "{got} {expected}");
    }
}

/// Checks that steps from the recorded states lead to the same states as Gymnasium's.
fn follows<T: Task, const N: usize>(
    task: &mut T,
    steps: &[Step],
    state: impl Fn(&mut T) -> &mut [f64; N],
) {
    let mut rng = Seed::new(1).rng();
    let mut observed = Vec::new();
    for step in steps {
        state(task).copy_from_slice(&step.state);
        let outcome = task.step(step.action as usize, &mut rng);
        task.observe(&mut observed);
        close(state(task), &step.next, 1e-12);
        // Gymnasium observes in single precision.
        close(&observed, &step.observed, 2e-6);
        close(&[outcome.reward], &[step.reward], 1e-12);
        assert_eq!(outcome.ending, Ending::terminal_if(step.terminal));
    }
    let terminals = steps.iter().filter(|step| step.terminal).count();
    assert!(steps.len() >= 20 && terminals > 1, "{terminals} terminals are checked");
}

#[test]
fn acrobot_steps_as_gymnasium() {
    follows(&mut Acrobot::default(), &golden().acrobot, |task| &mut task.state);
}

#[test]
fn cart_pole_steps_as_gymnasium() {
    follows(&mut CartPole::default(), &golden().cart_pole, |task| &mut task.state);
}

#[test]
fn puddle_world_steps_as_its_definition() {
    let mut still = PuddleWorld::default();
    still.noise = 0.0;
    follows(&mut still, &golden().puddle_world, |task| &mut task.state);
}

#[test]
fn pendulum_steps_as_gymnasium() {
    let mut task = Pendulum::default();
    let mut observed = Vec::new();
    let steps = golden().pendulum;
    assert!(steps.len() >= 20);
    for step in steps {
        task.state.copy_from_slice(&step.state);
        let reward = task.push(step.action);
        task.observe(&mut observed);
        close(&task.state, &step.next, 1e-12);
        close(&observed, &step.observed, 2e-6);
        close(&[reward], &[step.reward], 1e-12);
        assert!(!step.terminal);
    }
}

/// Returns the states of a rollout with random actions.
fn rollout<T: Task + Default>(begin: Begin, seed: u64) -> Vec<f32> {
    let mut simulated = Simulated::new(T::default(), begin);
    let mut rng = Seed::new(seed).rng();
    let mut state = vec![0.0; simulated.columns()];
    let mut all = Vec::new();
    for _ in 0..20 {
        simulated.start(&mut rng, &mut state);
        for _ in 0..30 {
            all.extend_from_slice(&state);
            let action = rng.below(simulated.actions());
            if simulated.step(action, &mut rng, &mut state).ending == Ending::Terminal {
                break;
            }
        }
    }
    all
}

/// Checks that states are scaled, that episodes begin in the chosen start states, and
/// that equal seeds give equal rollouts.
fn is_an_environment<T: Task + Default>() {
    for begin in [Begin::AsTheTask, Begin::Anywhere] {
        let one = rollout::<T>(begin, 3);
        assert!(one.iter().all(|value| (-0.5..=1.5).contains(value)), "{one:?}");
        assert_eq!(one, rollout::<T>(begin, 3));
        assert_ne!(one, rollout::<T>(begin, 4));
    }
}

#[test]
fn tasks_are_environments() {
    is_an_environment::<Acrobot>();
    is_an_environment::<CartPole>();
    is_an_environment::<Pendulum>();
    is_an_environment::<PuddleWorld>();
}

#[test]
fn the_reward_of_a_plant_follows_from_what_it_logs() {
    let study = format!("actions = [\"DOSE_MG_L\"]\nreward = {}", Membrane::reward());
    let config: ControlConfig = toml::from_str(&study).expect("valid");
    config.check().expect("valid");
    let mut plant = Membrane::new(Seed::new(1));
    let mut rng = Seed::new(2).rng();
    plant.start_anywhere(&mut rng);
    let mut observed = Vec::new();
    let mut trips = 0;
    for number in 0..1500 {
        let action = if number < 100 { number % 8 } else { 5 };
        let outcome = plant.step(action, &mut rng);
        plant.observe(&mut observed);
        let mut logged = Vec::new();
        plant.log(&mut logged);
        let names: Vec<String> = config.reward.columns().cloned().collect();
        let mut values = Vec::new();
        for name in &names {
            let seen = Membrane::columns().iter().position(|column| column.0 == name);
            let beside = Membrane::logged().iter().position(|&other| other == name);
            let value = seen.map(|place| observed[place]).or(beside.map(|place| logged[place]));
            values.push(vec![value.expect("a column of the log")]);
        }
        let columns = RewardColumns { names: &names, values: &values, actions: 0 };
        let one = Segments::from_lengths([1]).expect("a row");
        let reward = f64::from(config.reward.of_rows(&columns, &one, |_| true)[0]);
        assert!((reward - outcome.reward).abs() < 1e-4, "{reward} {outcome:?}");
        if outcome.ending == Ending::Terminal {
            trips += 1;
            plant.start_anywhere(&mut rng);
        }
    }
    assert!(trips > 0, "some steps trip the plant");
}

#[test]
fn operators_do_better_than_chance_and_a_log_has_what_is_beside_the_state() {
    let span = TaskKind::Membrane.timeout();
    let mut plant = Simulated::new(Membrane::new(Seed::new(4)), Begin::AsTheTask);
    let mut rule = Behaviour::rule_of::<Membrane>().expect("a rule");
    let by_rule = rule.mean_return(&mut plant, 10, span, Seed::new(5));
    let by_chance = Behaviour::Random.mean_return(&mut plant, 10, span, Seed::new(5));
    assert!(by_rule > by_chance + 100.0, "{by_rule} {by_chance}");
    assert!(Behaviour::rule_of::<CartPole>().is_none());
    let mut perturbed = rule.perturbed(Quality::Perturbed.random_share());
    let log = record(&mut perturbed, &mut plant, 600, span, Seed::new(6));
    assert_eq!(log.beside.len(), 4 * log.actions.len());
    let log = log.decisions(8).expect("a log");
    assert!(log.counts().iter().all(|&count| count > 0), "{:?}", log.counts());
}
