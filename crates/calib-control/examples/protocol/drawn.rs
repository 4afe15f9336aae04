//! Tasks for which no default can be known in advance. Each is a classic task with its own reward scale, share of random actions, length
//! of a step and discount. docs/control.md, "Tasks that are drawn", has the protocol, and `scripts/drawn_protocol.py` makes its table.

use std::{
    fs::{self, OpenOptions},
    io::Write as _,
    ops::Range,
    path::Path,
};

use calib_control::{
    Acrobot, ActionModel, ActionModelConfig, AgentConfig, Begin, CartPole, Environment as _,
    Outcome as Step, PuddleWorld, Quality, RunBudget, RunLength, Simulated, Starts, Task, TaskKind,
    record, truth,
};
use calib_core::{Rng, Seed, Silent};
use serde_json::{Value, json};

use super::{Outcome, STEPS, Study, behaviour, best_of, means, pooled, starts, with};

/// Runs per setting. Their mean is its true return.
const TRUTH_RUNS: usize = 8;
/// Numbers of steps of a task's two logs.
const LENGTHS: [usize; 2] = [500, 5000];
const DISCOUNTS: [f64; 4] = [0.9, 0.95, 0.99, 1.0];

/// A task with scaled rewards, in which some actions are replaced by random ones.
#[derive(Clone)]
struct Drawn<T> {
    task: T,
    reward_scale: f64,
    slip: f64,
}

impl<T: Task> Task for Drawn<T> {
    fn columns() -> &'static [(&'static str, f64, f64)] {
        T::columns()
    }

    fn actions() -> &'static [&'static str] {
        T::actions()
    }

    fn start(&mut self, rng: &mut Rng) {
        self.task.start(rng);
    }

    fn start_anywhere(&mut self, rng: &mut Rng) {
        self.task.start_anywhere(rng);
    }

    fn observe(&self, observed: &mut Vec<f64>) {
        self.task.observe(observed);
    }

    fn step(&mut self, action: usize, rng: &mut Rng) -> Step {
        let action = if rng.unit() < self.slip { rng.below(T::actions().len()) } else { action };
        let step = self.task.step(action, rng);
        Step { reward: self.reward_scale * step.reward, ..step }
    }
}

/// The properties in which a task differs from the others of its kind.
struct Variant {
    kind: TaskKind,
    number: usize,
    reward_scale: f64,
    slip: f64,
    /// Length of a step, as a multiple of the classic one.
    longer_steps: f64,
    gamma: f64,
    quality: Quality,
}

impl Variant {
    fn draw(kind: TaskKind, number: usize) -> Self {
        let mut rng = Seed::new(3).child("drawn").child(kind.name()).number(number as u64).rng();
        Self {
            kind,
            number,
            reward_scale: 10_f64.powf(rng.uniform(-2.0, 2.0)),
            slip: rng.uniform(0.0, 0.2),
            longer_steps: rng.uniform(0.5, 2.0),
            gamma: DISCOUNTS[rng.below(DISCOUNTS.len())],
            quality: Quality::PUBLISHED[rng.below(Quality::PUBLISHED.len())],
        }
    }

    /// Returns the name of the line of a log with this many steps.
    fn log_name(&self, length: usize) -> String {
        format!("{}/{}/{length}", self.kind.name(), self.number)
    }

    fn seed(&self) -> Seed {
        Seed::new(4).child("drawn").child(self.kind.name()).number(self.number as u64)
    }
}

/// Writes two logs of each of these tasks of each kind, one line per log. Existing lines are kept.
pub(super) fn run(path: &Path, numbers: Range<usize>) -> Outcome<()> {
    for number in numbers {
        let [cart_pole, puddle_world, acrobot] =
            [TaskKind::CartPole, TaskKind::PuddleWorld, TaskKind::Acrobot]
                .map(|kind| Variant::draw(kind, number));
        logs(path, &cart_pole, CartPole::with_longer_steps(cart_pole.longer_steps))?;
        logs(path, &puddle_world, PuddleWorld::with_longer_steps(puddle_world.longer_steps))?;
        logs(path, &acrobot, Acrobot::with_longer_steps(acrobot.longer_steps))?;
    }
    Ok(())
}

fn logs<T: Task>(path: &Path, variant: &Variant, task: T) -> Outcome<()> {
    let lines = fs::read_to_string(path).unwrap_or_default();
    let done: Vec<Value> =
        lines.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
    let left = LENGTHS.into_iter().filter(|&length| {
        let name = variant.log_name(length);
        !done.iter().any(|line| line["name"] == name.as_str())
    });
    let left: Vec<usize> = left.collect();
    if left.is_empty() {
        return Ok(());
    }
    let task = Drawn { task, reward_scale: variant.reward_scale, slip: variant.slip };
    let candidates = Study::candidates()?.into_iter();
    let candidates: Vec<AgentConfig> =
        candidates.map(|agent| AgentConfig { gamma: variant.gamma, ..agent }).collect();
    let returns = true_returns(variant, &task, &candidates)?;
    for length in left {
        let line = one_log(variant, &task, length, &candidates, &returns)?;
        let mut file = OpenOptions::new().create(true).append(true).open(path)?;
        writeln!(file, "{}", with(line, &variant.log_name(length)))?;
    }
    Ok(())
}

/// Returns the mean return of each agent in the task itself.
fn true_returns<T: Task>(
    variant: &Variant,
    task: &Drawn<T>,
    agents: &[AgentConfig],
) -> Outcome<Vec<f64>> {
    let span = RunLength { steps: STEPS, timeout: variant.kind.timeout() };
    let budget = RunBudget { runs: TRUTH_RUNS, span };
    let returns = truth(
        || Simulated::new(task.clone(), Begin::AsTheTask),
        agents,
        budget,
        variant.seed(),
        &Silent,
    );
    Ok(means(&returns?))
}

fn one_log<T: Task>(
    variant: &Variant,
    task: &Drawn<T>,
    length: usize,
    candidates: &[AgentConfig],
    returns: &[f64],
) -> Outcome<Value> {
    let Variant { kind, reward_scale, slip, longer_steps, gamma, quality, .. } = *variant;
    let timeout = kind.timeout();
    let seed = variant.seed().number(length as u64);
    let mut world = Simulated::new(task.clone(), Begin::AsTheTask);
    // The behaviour should be as good as the best setting is on average, including the learning phase.
    let wanted = returns.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let best = best_of(candidates, returns);
    let mut behaviour = behaviour(quality, (best, wanted), timeout, &mut world, seed);
    let mut anywhere = Simulated::new(task.clone(), Begin::Anywhere);
    let recorded = record(&mut behaviour, &mut anywhere, length, timeout, seed.child("log"));
    let log = recorded.decisions(world.actions())?;
    let spread = log.return_spread(gamma, timeout).unwrap_or(reward_scale);
    let scaled = in_units_of(spread, gamma);
    let begin = starts(&mut world, seed.child("starts"))?;
    let begin = Starts { observed: begin.clone(), metric: begin };
    let config = ActionModelConfig::default();
    let worst = reward_scale * kind.worst_return();
    let states = log.states().clone();
    let model = ActionModel::build(log, &states, begin, &config, worst, &Silent)?;
    let mut line = pooled(&model, candidates, timeout, seed)?;
    line["drawn"] = json!({
        "reward_scale": reward_scale, "slip": slip, "longer_steps": longer_steps, "gamma": gamma,
        "behaviour": quality.name(),
    });
    line["spread"] = json!(spread);
    line["truth"] = json!(returns);
    line["scaled"] =
        json!(UNITS.map(|units| json!([units.step_size, units.temperature, units.initial_weight])));
    line["truth_of_scaled"] = json!(true_returns(variant, task, &scaled)?);
    Ok(line)
}

/// An agent whose step size, temperature and first value are in units of the spread of recorded returns. Adam moves a value by about
/// one step size per step, whatever the size of the rewards. So step sizes have the unit of returns too.
#[derive(Clone, Copy)]
struct InUnits {
    step_size: f64,
    temperature: f64,
    initial_weight: f64,
}

const UNITS: [InUnits; 12] = {
    let mut all = [InUnits { step_size: 0.0, temperature: 0.0, initial_weight: 0.0 }; 12];
    let mut place = 0;
    while place < 12 {
        all[place] = InUnits {
            step_size: [0.003, 0.03][place % 2],
            initial_weight: [0.0, 1.0][place / 2 % 2],
            temperature: [0.001, 0.01, 0.1][place / 4],
        };
        place += 1;
    }
    all
};

fn in_units_of(spread: f64, gamma: f64) -> Vec<AgentConfig> {
    let agents = UNITS.iter().map(|units| AgentConfig {
        step_size: spread * units.step_size,
        temperature: spread * units.temperature,
        initial_weight: spread * units.initial_weight,
        gamma,
        ..AgentConfig::default()
    });
    agents.collect()
}
