use std::{
    io::Write as _,
    path::{Path, PathBuf},
};

use calib_base::{Context as _, StepError, ensure, output::Printer};
use calib_control::{
    Acrobot, Agent, Begin, Behaviour, CartPole, Ending, Environment as _, Membrane, Pendulum,
    PuddleWorld, Quality, Recorded, RunLength, Simulated, Task, TaskKind, record,
};
use calib_core::{Seed, Timestamp};
use calib_data::table::write_log;
use calib_files::{FolderRecord, check_output, write_output};
use schemars::JsonSchema;
use serde::Serialize;

use super::show::held;

/// A request for a log of a task whose true values are known.
#[derive(Clone, Debug)]
pub struct SimulateTask {
    /// The folder to write to.
    pub directory: PathBuf,
    /// The task.
    pub task: TaskKind,
    /// The policy to record.
    pub policy: Quality,
    /// Number of transitions.
    pub transitions: usize,
    /// Root of all random seeds.
    pub seed: u64,
    /// Whether existing files may be replaced.
    pub existing: calib_base::options::ExistingFile,
}

/// A simulated log of a task whose true returns are known.
#[derive(Debug, Serialize, JsonSchema)]
pub struct SimulatedTask {
    /// Path of the log.
    pub log: PathBuf,
    /// Path of a study of the log.
    pub study: PathBuf,
    /// Number of transitions in the log.
    pub transitions: usize,
    /// Number of episodes in the log.
    pub episodes: usize,
    /// Number of episodes that end in a terminal.
    pub terminals: usize,
    /// Mean return of the recorded policy from the start states of the task, over 100 episodes.
    pub behaviour: f64,
}

impl SimulatedTask {
    /// Describes the written files in a line.
    pub fn line(&self) -> String {
        format!(
            "{}, in {}; the policy gets {:.1} per episode",
            held(self.transitions, self.episodes, self.terminals),
            self.log.display(),
            self.behaviour
        )
    }
}

/// Steps after which a behaviour that is not near-optimal stops learning.
const LEARNING: usize = 200_000;
/// Steps between episodes: a gap, which ends a segment.
const PAUSE: i64 = 60;

/// Returns the microseconds from one row to the next.
const fn step(kind: TaskKind) -> i64 {
    match kind {
        TaskKind::Membrane => 1_800_000_000,
        _ => 1_000_000,
    }
}

/// Writes the log of a policy in a task, and a study of it.
pub(crate) fn simulate(
    wanted: &SimulateTask,
    printer: &Printer,
) -> Result<SimulatedTask, StepError> {
    ensure!(wanted.transitions > 0, "--transitions must be at least 1");
    let log = wanted.directory.join("log.parquet");
    let study = wanted.directory.join("study.toml");
    for path in [&log, &study] {
        check_output(path, wanted.existing)?;
    }
    // The user named the folder and not its files, so only files that calib wrote are replaced.
    FolderRecord::open(&wanted.directory)?.note(["log.parquet", "study.toml"])?;
    printer.say(&format!("{} behaviour in {}", wanted.policy.name(), wanted.task.name()));
    match wanted.task {
        TaskKind::Acrobot => simulated(wanted, &Acrobot::default(), &log, &study),
        TaskKind::CartPole => simulated(wanted, &CartPole::default(), &log, &study),
        TaskKind::Membrane => {
            let plant = Membrane::new(Seed::new(wanted.seed));
            simulated(wanted, &plant, &log, &study)
        }
        TaskKind::Pendulum => simulated(wanted, &Pendulum::continuous(), &log, &study),
        TaskKind::PuddleWorld => simulated(wanted, &PuddleWorld::default(), &log, &study),
    }
}

fn simulated<T: Task>(
    wanted: &SimulateTask,
    task: &T,
    log: &Path,
    study: &Path,
) -> Result<SimulatedTask, StepError> {
    let kind = wanted.task;
    let timeout = kind.timeout();
    let seed = Seed::new(wanted.seed).child(kind.name()).child(wanted.policy.name());
    let mut world = Simulated::new(task.clone(), Begin::AsTheTask);
    let mut behaviour = behaviour::<T>(wanted, &mut world, seed)?;
    let behaved = behaviour.mean_return(&mut world, 100, timeout, seed.child("behaved"));
    // The log of a plant begins after cleaning.
    let begin = if T::rule().is_some() { Begin::AsTheTask } else { Begin::Anywhere };
    let mut logged = Simulated::new(task.clone(), begin);
    let recorded =
        record(&mut behaviour, &mut logged, wanted.transitions, timeout, seed.child("log"));
    write::<T>(log, &recorded, step(kind))?;
    let text = text(kind, T::continuous(), wanted.seed);
    write_output(study, wanted.existing, |file| file.write_all(text.as_bytes()))?;
    Ok(SimulatedTask {
        log: log.to_owned(),
        study: study.to_owned(),
        transitions: wanted.transitions,
        episodes: recorded.lengths.len(),
        terminals: recorded.endings.iter().filter(|&&ending| ending == Ending::Terminal).count(),
        behaviour: behaved,
    })
}

/// Returns the requested policy.
fn behaviour<T: Task>(
    wanted: &SimulateTask,
    world: &mut Simulated<T>,
    seed: Seed,
) -> Result<Behaviour, StepError> {
    let kind = wanted.task;
    let policy = wanted.policy;
    if policy == Quality::Random {
        return Ok(Behaviour::Random);
    }
    if policy.is_rule() {
        let rule = Behaviour::rule_of::<T>().with_context(|| {
            format!(
                "nobody operates {} by a rule; take --policy near-optimal, medium or random",
                kind.name()
            )
        })?;
        return Ok(rule.perturbed(policy.random_share()));
    }
    let agent = Agent::new(kind.good_agent(), world.columns(), world.actions());
    let span = RunLength { steps: LEARNING, timeout: kind.timeout() };
    let wants = kind.near_optimal();
    let learned = Behaviour::learned(agent, world, wants, span, seed.child("behaviour"));
    Ok(learned.perturbed(policy.random_share()))
}

/// Writes one row per step in the task's own units, with a gap between episodes.
fn write<T: Task>(path: &Path, recorded: &Recorded, step: i64) -> Result<(), StepError> {
    let mut timestamps = Vec::with_capacity(recorded.actions.len());
    // 2024-01-01.
    let mut now = 1_704_067_200_000_000;
    for &length in &recorded.lengths {
        for _ in 0..length {
            timestamps.push(Timestamp::from_micros(now));
            now += step;
        }
        now += PAUSE * step;
    }
    let width = T::columns().len();
    let mut channels: Vec<(&str, Vec<f32>)> = Vec::new();
    for (place, &(name, low, high)) in T::columns().iter().enumerate() {
        let scaled = recorded.states.iter().skip(place).step_by(width);
        channels.push((
            name,
            scaled.map(|&share| (low + f64::from(share) * (high - low)) as f32).collect(),
        ));
    }
    if let Some(name) = T::continuous() {
        channels.push((name, set_in(recorded)));
    }
    for (name, values) in T::settings().into_iter().filter(|_| T::continuous().is_none()) {
        channels.push((
            name,
            recorded
                .actions
                .iter()
                .map(|action| action.map_or(f32::NAN, |action| values[usize::from(action)] as f32))
                .collect(),
        ));
    }
    if T::continuous().is_none() {
        let probabilities =
            recorded.probabilities.iter().map(|&probability| probability as f32).collect();
        channels.push(("probability", probabilities));
    }
    for (place, &name) in T::logged().iter().enumerate() {
        let own = recorded.beside.iter().skip(place).step_by(T::logged().len());
        channels.push((name, own.map(|&value| value as f32).collect()));
    }
    if T::logged().is_empty() {
        channels.push(("reward", recorded.rewards.clone()));
        channels.push((
            "terminal",
            recorded
                .endings
                .iter()
                .map(|&ending| f32::from(u8::from(ending == Ending::Terminal)))
                .collect(),
        ));
    }
    Ok(write_log(path, &timestamps, &channels)?)
}

/// Returns the recorded setting of each row. The environment logs it with the row that it led to.
fn set_in(recorded: &Recorded) -> Vec<f32> {
    let later = recorded.beside.iter().skip(1).chain([&f64::NAN]);
    let acted = recorded.actions.iter().zip(later);
    acted.map(|(action, &set)| action.map_or(f32::NAN, |_| set as f32)).collect()
}

/// Returns a study of the log.
fn text(kind: TaskKind, continuous: Option<&str>, seed: u64) -> String {
    if kind == TaskKind::Membrane {
        return membrane_text(seed);
    }
    format!(
        "# A log of {name} and the published grid of 54 agents: `calib control` says which to deploy.\n\
         seed = {seed}\n\n\
         [data]\npath = \"log.parquet\"\ntrain_fraction = 1.0\n\n\
         [preprocess]\noutliers = \"keep\"\n\n\
         [control]\n{actions}reward = \"reward\"\n{terminal}\
         timeout = {timeout}\nworst_return = {worst:?}\nsteps = 15000\n\n\
         [control.grid]\nstep_size = [0.003, 0.03, 0.3]\nbeta1 = [0.0, 0.9]\n\
         temperature = [1.0, 10.0, 100.0]\ninitial_weight = [0.0, 8.0, 16.0]\n",
        name = kind.name(),
        actions = match continuous {
            Some(name) => format!("actions = [\"{name}\"]\nlevels = 7 # of a torque that is continuous\n"),
            None => "actions = [\"action\"]\nprobability = \"probability\" # of the action that was taken\n"
                .to_owned(),
        },
        terminal = if kind.ends() { "terminal = \"terminal\"\n" } else { "" },
        timeout = kind.timeout(),
        worst = kind.worst_return(),
    )
}

/// Returns a study of a membrane plant: four settings, a reward in cents, and the columns that
/// belong to neither.
fn membrane_text(seed: u64) -> String {
    let settings = Membrane::settings();
    let settings: Vec<&str> = settings.iter().map(|setting| setting.0).collect();
    let state = Membrane::columns();
    let logged = Membrane::logged();
    let exclude = &logged[..logged.len() - 1];
    let cleaned = logged[logged.len() - 1];
    format!(
        "# A log of a membrane plant whose recipe is chosen every half hour: `calib control` says which agent to deploy.\n\
         # The state is {state}.\n\
         seed = {seed}\n\n\
         [data]\npath = \"log.parquet\"\ntrain_fraction = 1.0\n\
         exclude = {exclude:?} # of the step before, and no state\n\n\
         [preprocess]\noutliers = \"keep\"\n\n\
         [control]\nactions = {settings:?}\n\
         terminal = \"{cleaned}\" # the plant tripped and was cleaned\n\
         probability = \"probability\" # of the recipe that was taken\n\
         reward = {reward} # in cents\n\
         timeout = {timeout} # ten days\nworst_return = {worst:?}\nsteps = 17520 # a year\n\
         fewest_terminals = 0 # a careful plant hardly trips\n\n\
         [control.agent]\ngamma = 0.99 # an episode need not end\ntilings = 8\n\n\
         [control.grid]\nstep_size = [0.003, 0.03, 0.3]\ntemperature = [1.0, 10.0, 100.0]\n\
         initial_weight = [0.0, 400.0]\n",
        state = state.iter().map(|column| column.0).collect::<Vec<_>>().join(", "),
        reward = Membrane::reward(),
        timeout = TaskKind::Membrane.timeout(),
        worst = TaskKind::Membrane.worst_return(),
    )
}
