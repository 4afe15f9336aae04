//! Every candidate in every member.

use calib_core::{Cancelled, Monitor, Seed};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::{
    ActionModelKind, Agent, AgentConfig, AgentRun, ControlError, Coverage, Drift, Ensemble,
    Environment, ModelEnvironment as _, RunLength, run_agent,
};

/// What came of one candidate in one run of one member.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// What the member is.
    #[serde(default)]
    pub kind: ActionModelKind,
    /// The member.
    pub member: usize,
    /// Which run in it.
    pub run: usize,
    /// The candidate.
    pub candidate: usize,
    /// Mean return an episode, learning included; −∞ if it diverged (`"-inf"` in files).
    #[serde(with = "calib_stats::diverged")]
    pub mean_return: f64,
    /// Episodes that ended or were cut at the timeout.
    pub episodes: usize,
    /// Of these, those that ended in a terminal.
    pub terminals: usize,
    /// What its steps rested on.
    pub coverage: Coverage,
    /// Mean return of the episodes in each tenth of its episodes, in order: how it learnt. Empty with fewer than ten.
    pub curve: Vec<f64>,
    /// How far its episodes were moved by jumps between transitions.
    #[serde(default)]
    pub drift: Drift,
}

/// Which run it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RunId {
    /// What the member is.
    pub kind: ActionModelKind,
    /// The member.
    pub member: usize,
    /// Which run in it.
    pub run: usize,
    /// The candidate.
    pub candidate: usize,
}

impl Run {
    /// Which run it is.
    pub fn id(&self) -> RunId {
        let Self { kind, member, run, candidate, .. } = *self;
        RunId { kind, member, run, candidate }
    }

    /// The run of an agent that could not go on: as of one that diverged before its first step.
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

/// Whoever keeps runs, so that a sweep that was stopped goes on from them.
pub trait RunKeeper: Sync {
    /// What came of this run, if it was kept.
    fn known(&self, id: RunId) -> Option<Run>;

    /// Keep a run.
    ///
    /// # Errors
    /// If it cannot be kept.
    fn keep(&self, run: &Run) -> Result<(), ControlError>;

    /// Whether the run with this number, in the order of kinds of models, members, runs and candidates, is to be made here.
    fn has(&self, _number: usize) -> bool {
        true
    }
}

/// Nothing is kept.
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

/// The agents that are compared: calib's own, or those of somebody else.
pub trait ActingAgents: Sync {
    /// How many there are.
    fn count(&self) -> usize;

    /// Let agent `candidate`, which knows nothing of earlier runs, act and learn in `environment`.
    ///
    /// # Errors
    /// If the monitor interrupts, or no agent can go on.
    fn run(
        &self,
        candidate: usize,
        environment: &mut dyn Environment,
        span: RunLength,
        seed: Seed,
        monitor: &dyn Monitor,
    ) -> Result<AgentRun, ControlError>;

    /// Whether agent `candidate` could not go on in some run. What came of it then is not kept.
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

/// How much is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extent {
    /// Runs of each setting in each ensemble member.
    pub runs: usize,
    /// Each of them.
    pub span: RunLength,
}

/// Let every candidate learn anew in every member, in `extent.runs` runs; in the order of members, runs and candidates.
///
/// Candidates act differently, so each walks its own way: a unit is one candidate in one run of one member. Candidates of a run draw from
/// equal seeds, so that chance differs as little as it can. The result does not depend on the number of threads.
///
/// # Errors
/// If the monitor interrupts.
pub fn sweep<M: Ensemble>(
    model: &M,
    candidates: &[AgentConfig],
    extent: Extent,
    seed: Seed,
    monitor: &dyn Monitor,
) -> Result<Vec<Run>, ControlError> {
    let ids = runs_here(model.kind(), model.members(), extent.runs, candidates.len(), &NotKept);
    sweep_keeping(model, &candidates, ids, extent.span, seed, &NotKept, monitor)
}

/// The runs of a kind of models that `keeper` wants made here, in the order of members, runs and candidates. Of each member there are
/// `runs` of each candidate.
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

/// These runs of [`sweep`], in their order, with a `keeper`: those that it knows are not made again.
///
/// # Errors
/// If the monitor interrupts, an agent cannot go on, or a run cannot be kept.
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
            let mut walk = model.walk(member);
            let agent_run = agents.run(candidate, &mut walk, span, seed, monitor)?;
            let finished = Run {
                kind,
                member,
                run,
                candidate,
                mean_return: agent_run.mean_return(),
                episodes: agent_run.returns.len(),
                terminals: agent_run.terminals,
                coverage: walk.coverage(),
                curve: tenths(&agent_run.returns),
                drift: walk.drift(),
            };
            if !agents.has_failed(candidate) {
                keeper.keep(&finished)?;
            }
            monitor.advance(1);
            Ok(finished)
        })
        .collect()
}

/// The mean return of every candidate in an environment whose truth is known, `[runs][candidates]`; each run begins with `make`.
///
/// # Errors
/// If the monitor interrupts.
pub fn truth<E: Environment>(
    make: impl Fn() -> E + Sync,
    candidates: &[AgentConfig],
    extent: Extent,
    seed: Seed,
    monitor: &dyn Monitor,
) -> Result<Vec<Vec<f64>>, ControlError> {
    let units = extent.runs * candidates.len();
    monitor.begin("agents in the truth", units as u64);
    let flat: Result<Vec<f64>, Cancelled> = (0..units)
        .into_par_iter()
        .map(|unit| {
            monitor.check()?;
            let run = unit / candidates.len();
            let candidate = unit % candidates.len();
            let seed = seed.child("truth").number(run as u64);
            let agent_run = run_new_agent(candidates[candidate], &mut make(), extent.span, seed);
            monitor.advance(1);
            Ok(agent_run.mean_return())
        })
        .collect();
    Ok(flat?.chunks(candidates.len()).map(<[f64]>::to_vec).collect())
}

/// What run `run` of member `member` draws from, whatever acts in it: all candidates, and constant actions, meet the same chance.
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
    let bound = |tenth: usize| tenth * returns.len() / 10;
    (0..10)
        .map(|tenth| {
            let part = &returns[bound(tenth)..bound(tenth + 1)];
            part.iter().sum::<f64>() / part.len() as f64
        })
        .collect()
}

#[cfg(test)]
pub(crate) mod tests;
