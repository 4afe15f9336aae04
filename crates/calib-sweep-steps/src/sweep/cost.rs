//! Estimates the time of passes by timing a few of their steps.

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

use crate::sweep::agent_seed::agent_seed;

/// The agents that a pass trains.
#[derive(Clone, Copy)]
pub(crate) struct TrainedInPass<'a> {
    pub(crate) study: &'a Study,
    pub(crate) candidates: &'a [Candidate],
    /// Name and column of each sensor.
    pub(crate) sensors: &'a [(String, usize)],
    /// The checkpoints of pre-trained agents, by sensor.
    pub(crate) starts: &'a BTreeMap<String, Start>,
    /// Steps of every stream.
    pub(crate) steps: usize,
}

/// Seconds of a pass over a stream by all settings, on one thread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cost {
    /// The part that does not depend on the number of sensors.
    fixed: f64,
    /// The part per sensor.
    sensor: f64,
}

/// Duration of the timed steps.
const TIMED: Duration = Duration::from_millis(600);
/// Time limit of one timing. Longer ones are extrapolated from the steps made so far.
const LONGEST: Duration = Duration::from_millis(1_500);
/// Time limit of all timings in a command. After it, costs are extrapolated from earlier timings.
const ALL: Duration = Duration::from_secs(4);
/// Steps before the timing, in which buffers fill and caches warm up.
const WARMING: usize = 64;
/// Number of sensors that are trained side by side, to see what they share.
const BESIDE: usize = 4;
/// Largest number of steps of a stream for timing.
pub(crate) const MEASURED_STEPS: usize = 200_000;
/// Largest number of agents that are timed side by side.
const MOST_AGENTS: usize = 2_000;
/// Largest work of a timed step, in multiplications: about half a second.
const MOST_WORK: u64 = 2_000_000_000;

/// The timings of a command, over all models and deployments so far.
#[derive(Debug, Default)]
pub struct MeasuredPasses {
    spent: Cell<Duration>,
    /// Seconds and multiplications of the timed passes.
    passes: Cell<(f64, f64)>,
}

impl MeasuredPasses {
    /// Returns the extrapolated seconds for this work, if the time for timings is used up.
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
    /// Measures the cost of a sweep's passes over `environments`. Streams have at most [`MEASURED_STEPS`] of its steps.
    ///
    /// # Errors
    /// Returns an error if the sweep has no environments, agents cannot be trained, or the monitor interrupts.
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

    /// Measures the cost of passes over a stream that took `making` seconds to make.
    ///
    /// # Errors
    /// Returns an error if agents cannot be trained, or the monitor interrupts.
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

    /// Returns the seconds of a pass with this many sensors.
    pub fn of(self, sensors: usize) -> f64 {
        self.of_share(sensors, 1.0)
    }

    /// Returns the seconds of a pass with this many sensors that trains a share of the settings.
    pub(crate) fn of_share(self, sensors: usize, share: f64) -> f64 {
        self.fixed + sensors as f64 * self.sensor * share
    }
}

/// An agent for one sensor.
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

/// Returns the agents of the first `sensors` sensors, one per setting.
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

/// Returns the work of a pass of these agents, in multiplications.
fn work(trained: TrainedInPass<'_>, agents: &[Agent<'_>], width: usize) -> f64 {
    let each = agents.iter().map(|agent| agent.learner().work_per_step(width) as f64);
    each.sum::<f64>() * trained.steps as f64
}

/// Returns agents that are fast enough to time: a limited number, with fewer or smaller updates where a step would take
/// too long.
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

/// Returns the seconds of a pass of the first `sensors` sensors over a whole stream.
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

/// Returns the seconds of a pass of these agents over a whole stream.
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
        let watch = TimingMonitor { monitor, clock: Stopwatch::start(), done: AtomicU64::new(0) };
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
    // Before there are enough states for a mini-batch, a step costs almost nothing.
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

/// The result of a timing.
enum TimingResult {
    /// The time of the steps, in seconds.
    Secs(f64),
    /// The timing took too long. The value extrapolates the time of all steps from those made.
    Late(f64),
}

/// A monitor that asks to stop when a timing takes too long.
struct TimingMonitor<'a> {
    monitor: &'a dyn Monitor,
    clock: Stopwatch,
    /// Number of steps made.
    done: AtomicU64,
}

impl Monitor for TimingMonitor<'_> {
    fn begin(&self, _task: &str, _total: u64) {}

    fn advance(&self, units: u64) {
        self.done.fetch_add(units, Ordering::Relaxed);
    }

    fn interrupted(&self) -> bool {
        self.monitor.interrupted() || self.clock.elapsed() >= LONGEST
    }
}
