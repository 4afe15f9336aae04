use std::{
    io::Write as _,
    path::{Path, PathBuf},
};

use anyhow::ensure;
use calib_control::{
    Acrobot, Agent, Begin, Behaviour, CartPole, Ending, Environment as _, Pendulum, PuddleWorld,
    Quality, Recorded, Simulated, Span, Task, TaskKind, record,
};
use calib_core::{Seed, Timestamp};
use calib_data::table::write_log;
use calib_files::write_atomically;
use schemars::JsonSchema;
use serde::Serialize;

use crate::output::Printer;

/// A log to write of a classic task.
#[derive(Clone, Debug)]
pub struct SimulateTask {
    /// Where it goes.
    pub directory: PathBuf,
    /// The task.
    pub task: TaskKind,
    /// Whose policy is recorded.
    pub policy: Quality,
    /// Transitions.
    pub transitions: usize,
    /// Root of all randomness.
    pub seed: u64,
    /// Whether files that are there may be replaced.
    pub standing: crate::Standing,
}

/// A log of a classic task.
#[derive(Debug, Serialize, JsonSchema)]
pub struct SimulatedTask {
    /// The log.
    pub log: PathBuf,
    /// A study of it.
    pub study: PathBuf,
    /// Transitions in it.
    pub transitions: usize,
    /// Episodes in it.
    pub episodes: usize,
    /// Of these, those that end in a terminal.
    pub terminals: usize,
    /// Mean return of the policy where the task begins, over 100 episodes.
    pub behaviour: f64,
}

impl SimulatedTask {
    /// What there is now, in words.
    pub fn line(&self) -> String {
        format!(
            "{} transitions in {} episodes, {} of which end in a terminal, in {}; the policy gets {:.1} an episode",
            self.transitions,
            self.episodes,
            self.terminals,
            self.log.display(),
            self.behaviour
        )
    }
}

/// Steps after which behaviour that is not near-optimal stops learning.
const LEARNING: usize = 200_000;
/// Microseconds from one row to the next, and from one episode to the next: a gap, which ends a segment.
const STEP: i64 = 1_000_000;
const PAUSE: i64 = 60_000_000;

/// Write the log of a policy in a classic task, and a study of it.
pub(crate) fn simulate(wanted: &SimulateTask, printer: &Printer) -> anyhow::Result<SimulatedTask> {
    ensure!(wanted.transitions > 0, "--transitions must be at least 1");
    let log = wanted.directory.join("log.parquet");
    let study = wanted.directory.join("study.toml");
    if wanted.standing == crate::Standing::Kept {
        for path in [&log, &study] {
            ensure!(!path.exists(), "{} is there already; --force replaces it", path.display());
        }
    }
    calib_files::create_directory(&wanted.directory)?;
    printer.say(&format!("{} behaviour in {}", wanted.policy.name(), wanted.task.name()));
    match wanted.task {
        TaskKind::Acrobot => of(wanted, &Acrobot::default(), &log, &study),
        TaskKind::CartPole => of(wanted, &CartPole::default(), &log, &study),
        TaskKind::Pendulum => of(wanted, &Pendulum::default(), &log, &study),
        TaskKind::PuddleWorld => of(wanted, &PuddleWorld::default(), &log, &study),
    }
}

fn of<T: Task>(
    wanted: &SimulateTask,
    task: &T,
    log: &Path,
    study: &Path,
) -> anyhow::Result<SimulatedTask> {
    let (kind, timeout) = (wanted.task, wanted.task.timeout());
    let seed = Seed::new(wanted.seed).child(kind.name()).child(wanted.policy.name());
    let mut world = Simulated::new(task.clone(), Begin::AsTheTask);
    let mut behaviour = if wanted.policy == Quality::Random {
        Behaviour::Random
    } else {
        let agent = Agent::new(kind.good_agent(), world.columns(), world.actions());
        let span = Span { steps: LEARNING, timeout };
        let wants = kind.near_optimal();
        Behaviour::learnt(agent, &mut world, wants, span, seed.child("behaviour"))
            .perturbed(wanted.policy.random_share())
    };
    let behaved = behaviour.mean_return(&mut world, 100, timeout, seed.child("behaved"));
    let mut anywhere = Simulated::new(task.clone(), Begin::Anywhere);
    let recorded =
        record(&mut behaviour, &mut anywhere, wanted.transitions, timeout, seed.child("log"));
    write(log, &recorded, T::columns())?;
    let text = text(kind, wanted.seed);
    write_atomically(study, |file| file.write_all(text.as_bytes()))?;
    Ok(SimulatedTask {
        log: log.to_owned(),
        study: study.to_owned(),
        transitions: wanted.transitions,
        episodes: recorded.lengths.len(),
        terminals: recorded.endings.iter().filter(|&&of| of == Ending::Terminal).count(),
        behaviour: behaved,
    })
}

/// A row a step, in the task's own units; episodes a minute apart.
fn write(
    path: &Path,
    recorded: &Recorded,
    columns: &[(&'static str, f64, f64)],
) -> anyhow::Result<()> {
    let mut timestamps = Vec::with_capacity(recorded.actions.len());
    // 2024-01-01.
    let mut now = 1_704_067_200_000_000;
    for &length in &recorded.lengths {
        for _ in 0..length {
            timestamps.push(Timestamp::from_micros(now));
            now += STEP;
        }
        now += PAUSE;
    }
    let width = columns.len();
    let mut channels: Vec<(&str, Vec<f32>)> = Vec::with_capacity(width + 3);
    for (place, &(name, low, high)) in columns.iter().enumerate() {
        let scaled = recorded.states.iter().skip(place).step_by(width);
        let own = |&of: &f32| (low + f64::from(of) * (high - low)) as f32;
        channels.push((name, scaled.map(own).collect()));
    }
    let action = |of: &Option<u16>| of.map_or(f32::NAN, f32::from);
    channels.push(("action", recorded.actions.iter().map(action).collect()));
    channels.push(("reward", recorded.rewards.clone()));
    let terminal = |&of: &Ending| f32::from(u8::from(of == Ending::Terminal));
    channels.push(("terminal", recorded.endings.iter().map(terminal).collect()));
    Ok(write_log(path, &timestamps, &channels)?)
}

/// A study of the log, with the published grid.
fn text(kind: TaskKind, seed: u64) -> String {
    format!(
        "# A log of {name} and the published grid of 54 agents: `calib control` says which to deploy.\n\
         seed = {seed}\n\n\
         [data]\npath = \"log.parquet\"\ntrain_fraction = 1.0\n\n\
         [preprocess]\noutliers = \"keep\"\n\n\
         [control]\nactions = [\"action\"]\nreward = \"reward\"\n{terminal}\
         timeout = {timeout}\nworst_return = {worst:?}\nsteps = 15000\n\n\
         [control.grid]\nstep_size = [0.003, 0.03, 0.3]\nbeta1 = [0.0, 0.9]\n\
         temperature = [1.0, 10.0, 100.0]\ninitial_weight = [0.0, 8.0, 16.0]\n",
        name = kind.name(),
        terminal = if kind.ends() { "terminal = \"terminal\"\n" } else { "" },
        timeout = kind.timeout(),
        worst = kind.worst_return(),
    )
}
