//! Takes steps, so that `scripts/peers/control_steps.py` can measure steps per second:
//!
//! ```sh
//! cargo run --release -p calib-control --example steps -- acrobot|cart_pole|puddle_world task|model|agent-task|agent-model|deep-task|join|join-passive STEPS
//! ```
//!
//! `task` and `model` take random actions in the simulator, and in a model of 5,000 random transitions from it. `agent-…` lets Expected
//! Sarsa(λ) learn there, and `deep-…` lets Q-learning with a network learn. `join` makes the tables of a model of this many random
//! transitions. `join-passive` makes those of a model of the same states without actions. With 0 steps the program only prepares; subtract
//! that time.

use std::error::Error;

use calib_control::{
    Acrobot, ActionModel, ActionModelConfig, Agent, AgentConfig, Algorithm, Begin, Behaviour,
    CartPole, Ending, Ensemble as _, Environment, PuddleWorld, RunLength, Simulated, Starts, Task,
    TaskKind, record, run_agent,
};
use calib_core::{Seed, Silent};
use calib_knn::{KnnModel, ModelConfig};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [task, what, steps] = &arguments[..] else {
        return Err("expected a task, what to do there, and how many steps".into());
    };
    let steps: usize = steps.parse()?;
    match task.as_str() {
        "acrobot" => run(TaskKind::Acrobot, &Acrobot::default(), what, steps),
        "cart_pole" => run(TaskKind::CartPole, &CartPole::default(), what, steps),
        "puddle_world" => run(TaskKind::PuddleWorld, &PuddleWorld::default(), what, steps),
        other => Err(format!("`{other}` is no task").into()),
    }
}

fn run<T: Task>(kind: TaskKind, task: &T, what: &str, steps: usize) -> Result<(), Box<dyn Error>> {
    let mut world = Simulated::new(task.clone(), Begin::AsTheTask);
    let mut anywhere = Simulated::new(task.clone(), Begin::Anywhere);
    let rows = if what.starts_with("join") { steps.max(100) } else { 5000 };
    let recorded = record(&mut Behaviour::Random, &mut anywhere, rows, 500, Seed::new(1));
    let log = recorded.decisions(world.actions())?;
    let metric = log.states().clone();
    if what == "join-passive" {
        let config = ModelConfig { remove_traps: false, ..ModelConfig::default() };
        KnnModel::build(metric, log.transitions().clone(), &config, &Silent)?;
        return Ok(());
    }
    let starts = Starts { observed: metric.slice(0..30), metric: metric.slice(0..30) };
    let config = ActionModelConfig::default();
    let model = ActionModel::build(log, &metric, starts, &config, kind.worst_return(), &Silent)?;
    let mut rollout = model.rollout(0);
    match what {
        "task" => at_random(&mut world, steps),
        "model" => at_random(&mut rollout, steps),
        "agent-task" => learning(&mut world, kind.good_agent(), steps),
        "agent-model" => learning(&mut rollout, kind.good_agent(), steps),
        "deep-task" => learning(&mut world, deep(), steps),
        "join" => {}
        other => return Err(format!("`{other}` is nothing to do there").into()),
    }
    Ok(())
}

/// Takes random actions, in episodes of at most 500 steps.
fn at_random(environment: &mut dyn Environment, steps: usize) {
    let mut rng = Seed::new(2).rng();
    let mut state = vec![0.0; environment.columns()];
    let mut length = 0;
    for _ in 0..steps {
        if length == 0 {
            environment.start(&mut rng, &mut state);
        }
        let action = rng.below(environment.actions());
        let outcome = environment.step(action, &mut rng, &mut state);
        length = if outcome.ending == Ending::Terminal { 0 } else { (length + 1) % 500 };
    }
    std::hint::black_box(&state);
}

/// Q-learning with a network of 2 × 64 units and one batch of 32 per step.
fn deep() -> AgentConfig {
    AgentConfig { algorithm: Algorithm::DeepQLearning, step_size: 1e-4, ..AgentConfig::default() }
}

fn learning(environment: &mut dyn Environment, config: AgentConfig, steps: usize) {
    let config = AgentConfig { tilings: 16, ..config };
    let mut agent = Agent::new(config, environment.columns(), environment.actions());
    let run = run_agent(&mut agent, environment, RunLength { steps, timeout: 500 }, Seed::new(3));
    std::hint::black_box(run.mean_return());
}
