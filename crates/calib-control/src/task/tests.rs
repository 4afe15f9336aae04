use calib_core::Seed;
use serde::Deserialize;

use super::*;
use crate::{Ending, Environment};

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

/// Steps from the recorded states lead where Gymnasium's lead.
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
    assert!(steps.len() >= 200 && terminals > 1, "{terminals} terminals are checked");
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
    let mut still = PuddleWorld { noise: 0.0, ..PuddleWorld::default() };
    follows(&mut still, &golden().puddle_world, |task| &mut task.state);
}

#[test]
fn pendulum_steps_as_gymnasium() {
    let mut task = Pendulum::default();
    let mut observed = Vec::new();
    for step in golden().pendulum {
        task.state.copy_from_slice(&step.state);
        let reward = task.push(step.action);
        task.observe(&mut observed);
        close(&task.state, &step.next, 1e-12);
        close(&observed, &step.observed, 2e-6);
        close(&[reward], &[step.reward], 1e-12);
        assert!(!step.terminal);
    }
}

/// States are scaled, episodes begin where they say, and equal seeds give equal walks.
fn is_an_environment<T: Task + Default>() {
    for begin in [Begin::AsTheTask, Begin::Anywhere] {
        let walk = |seed: u64| -> Vec<f32> {
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
        };
        let one = walk(3);
        assert!(one.iter().all(|of| (-0.5..=1.5).contains(of)), "{one:?}");
        assert_eq!(one, walk(3));
        assert_ne!(one, walk(4));
    }
}

#[test]
fn tasks_are_environments() {
    is_an_environment::<Acrobot>();
    is_an_environment::<CartPole>();
    is_an_environment::<Pendulum>();
    is_an_environment::<PuddleWorld>();
}
