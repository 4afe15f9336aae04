//! What passes will take: a few steps of them are made and timed.

use std::{
    cell::Cell,
    collections::BTreeMap,
    sync::atomic::{AtomicU64, Ordering},
    time::Duration,
};

use calib_agent::{
    AgentConfig, AgentError, Checkpoint, CurveRule, Learner, NoKeeper, Run, train_learners,
};
use calib_base::{Context as _, StepError, clock::Stopwatch};
use calib_core::Monitor;
use calib_study::Study;
use calib_sweep::{Candidate, Environment, RunStream, Start};

use crate::sweep::setting::{SweepContext, agent_seed};

/// What a pass trains.
#[derive(Clone, Copy)]
pub(crate) struct TrainedInPass<'a> {
    pub(crate) study: &'a Study,
    pub(crate) candidates: &'a [Candidate],
    /// Name and column of each.
    pub(crate) sensors: &'a [(String, usize)],
    /// What agents start from, by sensor, if they were pre-trained.
    pub(crate) starts: &'a BTreeMap<String, Start>,
    /// Steps of every stream.
    pub(crate) steps: usize,
}

impl<'a> TrainedInPass<'a> {
    /// What the passes of a sweep train.
    pub(crate) fn of(study: &'a Study, setting: &'a SweepContext) -> Self {
        let SweepContext { groups, sensors, starts, .. } = setting;
        // What a pass takes does not depend on the discount factor.
        let group = &groups[0];
        let steps = group.streams.demand.span.steps;
        Self { study, candidates: &group.candidates, sensors, starts, steps }
    }
}

/// Seconds of a pass over a stream by all values, on one thread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cost {
    /// Whatever the number of sensors.
    fixed: f64,
    /// For each sensor.
    sensor: f64,
}

/// How long the steps take that are timed.
const TIMED: Duration = Duration::from_millis(600);
/// How long one timing takes at most: what is not over by then is told from what was done.
const LONGEST: Duration = Duration::from_millis(1_500);
/// How long a command measures; for what is left then it takes what it has measured.
const ALL: Duration = Duration::from_secs(4);
/// Steps that are made before: buffers fill, caches warm.
const WARMING: usize = 64;
/// Sensors that are trained beside one another to see what they share.
const BESIDE: usize = 4;
/// Steps of a stream that is made to be timed, at most.
pub(crate) const MEASURED_STEPS: usize = 200_000;
/// Agents that are timed beside one another, at most.
const MOST_AGENTS: usize = 2_000;
/// Work of a step that is timed, in multiplications, at most: about half a second.
const MOST_WORK: u64 = 2_000_000_000;

/// What a command has measured, of one model and deployment after the other.
#[derive(Debug, Default)]
pub struct MeasuredPasses {
    spent: Cell<Duration>,
    /// Seconds and multiplications of the passes that were timed.
    passes: Cell<(f64, f64)>,
}

impl MeasuredPasses {
    /// The seconds of so much work, where nothing more is to be measured.
    fn known(&self, work: f64) -> Option<f64> {
        let (secs, measured_work) = self.passes.get();
        (self.spent.get() >= ALL && measured_work > 0.0).then(|| secs * work / measured_work)
    }

    fn add(&self, clock: &Stopwatch, secs: f64, work: f64) {
        self.spent.set(self.spent.get() + clock.elapsed());
        let (all, measured_work) = self.passes.get();
        self.passes.set((all + secs, measured_work + work));
    }
}

impl Cost {
    /// Of the passes of a sweep over `environments`, whose streams have at most [`MEASURED_STEPS`] of its steps.
    ///
    /// # Errors
    /// If the sweep has no environments, agents cannot be trained, or the monitor interrupts.
    pub(crate) fn measure(
        trained: TrainedInPass<'_>,
        environments: &[Box<dyn Environment + '_>],
        measured: &MeasuredPasses,
        monitor: &dyn Monitor,
    ) -> Result<Self, StepError> {
        let environment = environments.iter().find(|environment| environment.runs() > 0);
        let environment = environment.context("the sweep has no runs")?;
        let clock = Stopwatch::start();
        let streamed = environment.stream(0)?;
        let made = streamed.stream.len().max(1) as f64;
        let making = clock.elapsed().as_secs_f64() * (trained.steps as f64 / made).max(1.0);
        Self::over(trained, &streamed, making, measured, monitor)
    }

    /// Of passes over a stream that took `making` seconds to make.
    ///
    /// # Errors
    /// If agents cannot be trained, or the monitor interrupts.
    pub(crate) fn over(
        trained: TrainedInPass<'_>,
        streamed: &RunStream,
        making: f64,
        measured: &MeasuredPasses,
        monitor: &dyn Monitor,
    ) -> Result<Self, StepError> {
        let work = work(trained, &agents(trained, 1), streamed.stream.width());
        if let Some(sensor) = measured.known(work) {
            return Ok(Self { fixed: making, sensor });
        }
        let clock = Stopwatch::start();
        let one = seconds(trained, streamed, 1, monitor)?;
        let beside = trained.sensors.len().min(BESIDE);
        if beside < 2 {
            measured.add(&clock, one, work);
            return Ok(Self { fixed: making, sensor: one });
        }
        let several = seconds(trained, streamed, beside, monitor)?;
        let sensor = ((several - one) / (beside - 1) as f64).clamp(0.3 * one, one);
        measured.add(&clock, sensor, work);
        Ok(Self { fixed: making + one - sensor, sensor })
    }

    /// Of a pass of so many sensors.
    pub fn of(self, sensors: usize) -> f64 {
        self.of_share(sensors, 1.0)
    }

    /// Of a pass of so many sensors that trains a share of the values.
    pub(crate) fn of_share(self, sensors: usize, share: f64) -> f64 {
        self.fixed + sensors as f64 * self.sensor * share
    }
}

/// An agent of a sensor.
struct Agent<'a> {
    config: AgentConfig,
    cumulant: usize,
    start: Option<&'a Checkpoint>,
}

impl Agent<'_> {
    fn learner(&self) -> Learner<'_> {
        Learner { config: &self.config, cumulant: self.cumulant, start: self.start, baseline: None }
    }
}

/// The agents of the first `sensors` sensors, one for each value.
fn agents(trained: TrainedInPass<'_>, sensors: usize) -> Vec<Agent<'_>> {
    trained.sensors[..sensors]
        .iter()
        .flat_map(|(sensor, column): &(String, usize)| {
            let start = trained.starts.get(sensor).map(|start| &start.checkpoint);
            let configs = trained.candidates.iter().map(|candidate| candidate.agent.clone());
            configs.map(|config| Agent { config, cumulant: *column, start }).collect::<Vec<_>>()
        })
        .collect()
}

/// What a pass of these agents costs, in multiplications.
fn work(trained: TrainedInPass<'_>, agents: &[Agent<'_>], width: usize) -> f64 {
    let each = agents.iter().map(|agent| agent.learner().work_per_step(width) as f64);
    each.sum::<f64>() * trained.steps as f64
}

/// The same agents, as far as some of their steps can be timed: not too many, and with fewer or smaller updates where a step
/// would take longer than anybody waits for.
fn timeable(all: Vec<Agent<'_>>, width: usize) -> Vec<Agent<'_>> {
    let every = all.len().div_ceil(MOST_AGENTS).max(1);
    let mut all: Vec<Agent<'_>> = all.into_iter().step_by(every).collect();
    let most = MOST_WORK / all.len().max(1) as u64;
    for agent in &mut all {
        let of_update = agent.learner().work_per_update(width);
        let config = &mut agent.config;
        let updates = usize::try_from(most / of_update).unwrap_or(usize::MAX).max(1);
        config.updates_per_step = config.updates_per_step.min(updates);
        let parts = usize::try_from(of_update.div_ceil(most.max(1))).unwrap_or(usize::MAX);
        config.batch_size = config.batch_size.div_ceil(parts).max(1);
    }
    all
}

/// Of a pass of the first `sensors` sensors over a whole stream.
fn seconds(
    trained: TrainedInPass<'_>,
    streamed: &RunStream,
    sensors: usize,
    monitor: &dyn Monitor,
) -> Result<f64, StepError> {
    let stream = &*streamed.stream;
    let all = agents(trained, sensors);
    let whole = work(trained, &all, stream.width());
    let timed = timeable(all, stream.width());
    let share = whole / work(trained, &timed, stream.width());
    Ok(share * seconds_of(trained, streamed, &timed, monitor)?)
}

/// Of a pass of these agents over a whole stream.
fn seconds_of(
    trained: TrainedInPass<'_>,
    streamed: &RunStream,
    agents: &[Agent<'_>],
    monitor: &dyn Monitor,
) -> Result<f64, StepError> {
    let stream = &*streamed.stream;
    let whole = trained.steps;
    let most = trained.steps.min(stream.len().saturating_sub(1));
    let learners: Vec<Learner<'_>> = agents.iter().map(Agent::learner).collect();
    let curve = CurveRule { windows: trained.study.sweep.curve_points };
    let seed = agent_seed(trained.study);
    let timed = |steps: usize| -> Result<TimingResult, StepError> {
        let run = Run { stream, steps, curve, seed };
        let watch = Deadline { monitor, clock: Stopwatch::start(), done: AtomicU64::new(0) };
        match train_learners(run, &learners, &NoKeeper, &watch) {
            Err(AgentError::Cancelled(_)) if !monitor.interrupted() => {
                let done = watch.done.into_inner().max(1) as f64;
                Ok(TimingResult::Late(watch.clock.elapsed().as_secs_f64() / done * whole as f64))
            }
            trained => {
                trained?;
                Ok(TimingResult::Secs(watch.clock.elapsed().as_secs_f64()))
            }
        }
    };
    // Until a mini-batch can be drawn a step costs next to nothing.
    let batches = agents.iter().map(|agent| agent.config.batch_size);
    let first = most.min(WARMING.max(batches.max().unwrap_or(0)));
    let before = match timed(first)? {
        TimingResult::Secs(secs) => secs,
        TimingResult::Late(secs) => return Ok(secs),
    };
    let mut steps = 16;
    loop {
        let last = most.min(first + steps);
        let after = match timed(last)? {
            TimingResult::Secs(secs) => secs,
            TimingResult::Late(secs) => return Ok(secs),
        };
        let took = (after - before).max(0.0);
        if last == whole {
            return Ok(after);
        }
        if last == most || took > TIMED.as_secs_f64() {
            let a_step = took / (last - first).max(1) as f64;
            return Ok(before + a_step * (whole - first) as f64);
        }
        steps *= if took < 0.1 * TIMED.as_secs_f64() { 8 } else { 2 };
    }
}

/// What became of a timing.
enum TimingResult {
    /// What the steps took, in seconds.
    Secs(f64),
    /// They took too long; what all steps take, by those that were made.
    Late(f64),
}

/// Asks to stop when a timing takes too long.
struct Deadline<'a> {
    monitor: &'a dyn Monitor,
    clock: Stopwatch,
    /// Steps that were made.
    done: AtomicU64,
}

impl Monitor for Deadline<'_> {
    fn begin(&self, _task: &str, _total: u64) {}

    fn advance(&self, units: u64) {
        self.done.fetch_add(units, Ordering::Relaxed);
    }

    fn interrupted(&self) -> bool {
        self.monitor.interrupted() || self.clock.elapsed() >= LONGEST
    }
}
