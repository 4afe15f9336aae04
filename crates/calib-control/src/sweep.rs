//! Runs every setting in every ensemble member.

use calib_core::{Cancelled, Monitor, Seed};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::{
    ActionModelKind, Agent, AgentConfig, AgentRun, ControlError, Coverage, Drift, Ensemble,
    Environment, ModelEnvironment as _, RunLength, run_agent,
};

/// The result of one training run: one setting in one ensemble member.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// The kind of model.
    #[serde(default)]
    pub kind: ActionModelKind,
    /// The ensemble member.
    pub member: usize,
    /// The number of the run in it.
    pub run: usize,
    /// The setting.
    pub candidate: usize,
    /// Mean return per episode, including the learning phase; −∞ if the agent diverged (`"-inf"` in files).
    #[serde(with = "calib_stats::diverged")]
    pub mean_return: f64,
    /// Episodes that ended or were cut at the timeout.
    pub episodes: usize,
    /// Number of these episodes that ended in a terminal.
    pub terminals: usize,
    /// Coverage of its steps.
    pub coverage: Coverage,
    /// Mean return of each tenth of its episodes, in order, as a learning curve. Empty with fewer than ten episodes.
    pub curve: Vec<f64>,
    /// Displacement of its episodes by jumps between transitions.
    #[serde(default)]
    pub drift: Drift,
}

/// The identity of a training run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RunId {
    /// The kind of model.
    pub kind: ActionModelKind,
    /// The ensemble member.
    pub member: usize,
    /// The number of the run in it.
    pub run: usize,
    /// The setting.
    pub candidate: usize,
}

impl Run {
    /// Returns the identity of the run.
    pub fn id(&self) -> RunId {
        let Self { kind, member, run, candidate, .. } = *self;
        RunId { kind, member, run, candidate }
    }

    /// Returns the run of an agent that could not continue, as if it had diverged before its first step.
    #[must_use]
    pub fn failed(self) -> Self {
        Self {
            mean_return: f64::NEG_INFINITY,
            episodes: 0,
            terminals: 0,
            coverage: Coverage::default(),
            curve: Vec::new(),
            drift: Drift::default(),
            ..self
        }
    }
}

/// Stores finished runs, so that an interrupted sweep can resume.
pub trait RunKeeper: Sync {
    /// Returns the stored result of this run, if there is one.
    fn known(&self, id: RunId) -> Option<Run>;

    /// Stores a run.
    ///
    /// # Errors
    /// If it cannot be stored.
    fn keep(&self, run: &Run) -> Result<(), ControlError>;

    /// Returns whether this process makes the run with this number. Runs are numbered in the order of kinds of models,
    /// ensemble members, runs and settings.
    fn has(&self, _number: usize) -> bool {
        true
    }
}

/// Stores no runs.
#[derive(Clone, Copy, Debug, Default)]
pub struct NotKept;

impl RunKeeper for NotKept {
    fn known(&self, _: RunId) -> Option<Run> {
        None
    }

    fn keep(&self, _: &Run) -> Result<(), ControlError> {
        Ok(())
    }
}

/// The agents that are compared: calib's own, or those of another program.
pub trait ActingAgents: Sync {
    /// Returns the number of agents.
    fn count(&self) -> usize;

    /// Lets agent `candidate`, which has learned nothing in earlier runs, act and learn in `environment`.
    ///
    /// # Errors
    /// If the monitor interrupts, or no agent can continue.
    fn run(
        &self,
        candidate: usize,
        environment: &mut dyn Environment,
        span: RunLength,
        seed: Seed,
        monitor: &dyn Monitor,
    ) -> Result<AgentRun, ControlError>;

    /// Returns whether agent `candidate` could not continue in some run. The result of such a run is not stored.
    fn has_failed(&self, _candidate: usize) -> bool {
        false
    }
}

impl ActingAgents for &[AgentConfig] {
    fn count(&self) -> usize {
        self.len()
    }

    fn run(
        &self,
        candidate: usize,
        environment: &mut dyn Environment,
        span: RunLength,
        seed: Seed,
        _monitor: &dyn Monitor,
    ) -> Result<AgentRun, ControlError> {
        Ok(run_new_agent(self[candidate], environment, span, seed))
    }
}

/// The number and length of the training runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RunBudget {
    /// Runs of each setting in each ensemble member.
    pub runs: usize,
    /// Length of each run.
    pub span: RunLength,
}

/// Lets every setting learn from scratch in every ensemble member, in `budget.runs` runs. Returns the runs in the order
/// of members, runs and settings.
///
/// Settings act differently, so each has its own rollout. The unit of work is one setting in one run of one member. All settings of a run
/// start from the same seed, so that random numbers differ as little as possible. The result does not depend on the number of threads.
///
/// # Errors
/// If the monitor interrupts.
pub fn sweep<M: Ensemble>(
    model: &M,
    candidates: &[AgentConfig],
    budget: RunBudget,
    seed: Seed,
    monitor: &dyn Monitor,
) -> Result<Vec<Run>, ControlError> {
    let ids = runs_here(model.kind(), model.members(), budget.runs, candidates.len(), &NotKept);
    sweep_keeping(model, &candidates, ids, budget.span, seed, &NotKept, monitor)
}

/// Returns the runs of a kind of models that `keeper` assigns to this process, in the order of ensemble members, runs and settings.
/// Each member has `runs` runs of each setting.
pub fn runs_here(
    kind: ActionModelKind,
    members: usize,
    runs: usize,
    candidates: usize,
    keeper: &dyn RunKeeper,
) -> Vec<RunId> {
    let of_member = runs * candidates;
    let all = members * of_member;
    let first = kind as usize * all;
    let own = (0..all).filter(|unit| keeper.has(first + unit));
    own.map(|unit| {
        let rest = unit % of_member;
        let (run, candidate) = (rest / candidates, rest % candidates);
        RunId { kind, member: unit / of_member, run, candidate }
    })
    .collect()
}

/// Makes these runs of [`sweep`], in their order. Runs that `keeper` has stored are not made again.
///
/// # Errors
/// If the monitor interrupts, an agent cannot continue, or a run cannot be stored.
pub fn sweep_keeping<M: Ensemble, A: ActingAgents + ?Sized>(
    model: &M,
    agents: &A,
    ids: Vec<RunId>,
    span: RunLength,
    seed: Seed,
    keeper: &dyn RunKeeper,
    monitor: &dyn Monitor,
) -> Result<Vec<Run>, ControlError> {
    let task = match model.kind() {
        ActionModelKind::Neighbors => "agents in neighbours",
        ActionModelKind::Increments => "agents in increments",
        ActionModelKind::Network => "agents in networks",
    };
    monitor.begin(task, ids.len() as u64);
    ids.into_par_iter()
        .map(|id: RunId| -> Result<Run, ControlError> {
            monitor.check()?;
            let RunId { kind, member, run, candidate } = id;
            if let Some(known) = keeper.known(id) {
                monitor.advance(1);
                return Ok(known);
            }
            let seed = run_seed(seed, member, run);
            let mut rollout = model.rollout(member);
            let agent_run = agents.run(candidate, &mut rollout, span, seed, monitor)?;
            let finished = Run {
                kind,
                member,
                run,
                candidate,
                mean_return: agent_run.mean_return(),
                episodes: agent_run.returns.len(),
                terminals: agent_run.terminals,
                coverage: rollout.coverage(),
                curve: tenths(&agent_run.returns),
                drift: rollout.drift(),
            };
            if !agents.has_failed(candidate) {
                keeper.keep(&finished)?;
            }
            monitor.advance(1);
            Ok(finished)
        })
        .collect()
}

/// Returns the mean return of every setting in an environment with known truth, `[runs][candidates]`. Each run starts in a new
/// environment from `make`.
///
/// # Errors
/// If the monitor interrupts.
pub fn truth<E: Environment>(
    make: impl Fn() -> E + Sync,
    candidates: &[AgentConfig],
    budget: RunBudget,
    seed: Seed,
    monitor: &dyn Monitor,
) -> Result<Vec<Vec<f64>>, ControlError> {
    let units = budget.runs * candidates.len();
    monitor.begin("agents in the truth", units as u64);
    let flat: Result<Vec<f64>, Cancelled> = (0..units)
        .into_par_iter()
        .map(|unit| {
            monitor.check()?;
            let run = unit / candidates.len();
            let candidate = unit % candidates.len();
            let seed = seed.child("truth").number(run as u64);
            let agent_run = run_new_agent(candidates[candidate], &mut make(), budget.span, seed);
            monitor.advance(1);
            Ok(agent_run.mean_return())
        })
        .collect();
    Ok(flat?.chunks(candidates.len()).map(<[f64]>::to_vec).collect())
}

/// Returns the seed of run `run` in ensemble member `member`. All settings and constant actions have the same one.
pub(crate) fn run_seed(seed: Seed, member: usize, run: usize) -> Seed {
    seed.child("member").number(member as u64).number(run as u64)
}

fn run_new_agent(
    config: AgentConfig,
    environment: &mut dyn Environment,
    span: RunLength,
    seed: Seed,
) -> AgentRun {
    let mut agent =
        Agent::seeded(config, environment.columns(), environment.actions(), seed.child("agent"));
    run_agent(&mut agent, environment, span, seed)
}

fn tenths(returns: &[f64]) -> Vec<f64> {
    if returns.len() < 10 {
        return Vec::new();
    }
    (0..10)
        .map(|tenth: usize| {
            let part = &returns[tenth * returns.len() / 10..(tenth + 1) * returns.len() / 10];
            part.iter().sum::<f64>() / part.len() as f64
        })
        .collect()
}

#[cfg(test)]
pub(crate) mod tests;
