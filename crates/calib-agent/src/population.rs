use calib_core::{Monitor, Seed, Stream};

use crate::{
    AgentConfig, AgentError, Learner, Precision, ReplayKind, ValueFunction,
    checkpointer::ValueState,
    linear::LinearValues,
    mlp::MlpValues,
    online::OnlineValues,
    outcome::Tracker,
    replay::Replay,
    returns::discounted_returns,
    scoring::{Part, ScoredReturns, known_returns, nothing_to_score},
    values::{Batch, Learned, Values},
};

/// Returns the initial value functions of learners of one kind and shape, for batches of up to `batch` transitions of a
/// stream.
pub(crate) fn values_of(
    learners: &[Learner<'_>],
    stream: &dyn Stream,
    batch: usize,
    seed: Seed,
) -> Box<dyn Values> {
    let config = learners[0].config;
    let mut values: Box<dyn Values> = match config.value_function {
        _ if config.optimiser.has_traces() => Box::new(OnlineValues::new(learners, stream)),
        ValueFunction::Mlp => Box::new(MlpValues::new(learners, stream, batch, seed)),
        ValueFunction::Linear => Box::new(LinearValues::new(learners, stream, seed)),
    };
    for (agent, learner) in learners.iter().enumerate() {
        if let Some(start) = learner.start {
            values.restore(agent, &ValueState::from(start));
        }
    }
    values
}

/// Whether two agents can learn in lockstep. They must share their input, the shape and precision of the value
/// function, γ, whether there are target networks, and everything that decides the transitions of an update.
pub(crate) fn can_share(a: &AgentConfig, b: &AgentConfig) -> bool {
    a.traces == b.traces
        && a.optimiser.has_traces() == b.optimiser.has_traces()
        && network_shape(a) == network_shape(b)
        && replay_sizes(a) == replay_sizes(b)
        && a.gamma == b.gamma
        && a.updates_per_step == b.updates_per_step
        && (a.target_network_period > 0) == (b.target_network_period > 0)
}

/// Returns hidden layers, units per layer and precision, or `None` without a network.
fn network_shape(config: &AgentConfig) -> Option<(usize, usize, Precision)> {
    match config.value_function {
        ValueFunction::Mlp => Some((config.hidden_layers, config.hidden_units, config.precision)),
        ValueFunction::Linear => None,
    }
}

/// Returns the replay capacity and the size of a mini-batch, or `None` without replay.
fn replay_sizes(config: &AgentConfig) -> Option<(usize, usize)> {
    match config.replay {
        ReplayKind::Uniform => Some((config.replay_capacity, config.batch_size)),
        ReplayKind::None => None,
    }
}

/// The data on which a population is trained and scored.
#[derive(Clone, Copy)]
pub(crate) struct Task<'a> {
    /// The stream, at least one state longer than the run. The states after the run only complete returns.
    pub(crate) stream: &'a dyn Stream,
    pub(crate) steps: usize,
    pub(crate) seed: Seed,
}

impl<'a> Task<'a> {
    /// Returns the steps of the run, in order, and whether their returns for `gamma` are known. No step leads from one
    /// piece into the next.
    pub(crate) fn course(self, gamma: f64) -> impl Iterator<Item = (usize, bool)> + use<'a> {
        self.stream.pieces().iter().flat_map(move |piece| {
            let known = known_returns(piece, gamma);
            let steps = piece.start..piece.end.saturating_sub(1).min(self.steps);
            steps.map(move |t| (t, known.contains(&t)))
        })
    }
}

/// The returns against which the predictions of a population are scored, for each predicted column.
pub(crate) struct Truth<'a> {
    /// The position of each learner's column among the returns.
    columns: Vec<usize>,
    /// The baseline to which each learner's value function is added.
    baselines: Vec<Option<&'a [f32]>>,
    returns: Vec<Vec<f64>>,
    /// Statistics of the returns of each column, part by part.
    scored: Vec<[Option<ScoredReturns>; Part::ALL.len()]>,
}

impl<'a> Truth<'a> {
    /// Returns the truth for learners that [`can_share`] with one another.
    pub(crate) fn new(task: Task<'_>, learners: &[Learner<'a>]) -> Result<Self, AgentError> {
        let Task { stream, steps, .. } = task;
        let gamma = learners[0].config.gamma;
        let mut distinct: Vec<usize> = learners.iter().map(|learner| learner.cumulant).collect();
        distinct.sort_unstable();
        distinct.dedup();
        let columns = learners
            .iter()
            .map(|learner| distinct.partition_point(|&cumulant| cumulant < learner.cumulant))
            .collect();
        let returns: Vec<_> =
            distinct.iter().map(|&column| discounted_returns(stream, column, gamma)).collect();
        let scored = returns
            .iter()
            .map(|returns| {
                let pieces = stream.pieces();
                let all = Part::ALL.map(|part| {
                    ScoredReturns::new(returns, pieces, gamma, part.first_step(steps)..steps)
                });
                let whole = all[Part::WholeRun as usize];
                whole.map(|_| all).ok_or_else(|| nothing_to_score(pieces, gamma, 0, steps))
            })
            .collect::<Result<_, _>>()?;
        let baselines = learners.iter().map(|learner| learner.baseline).collect();
        Ok(Self { columns, baselines, returns, scored })
    }

    /// Returns statistics of the returns that `learner` predicts in one part of the run.
    pub(crate) fn scored(&self, learner: usize, part: Part) -> Option<ScoredReturns> {
        self.scored[self.columns[learner]][part as usize]
    }

    /// Returns the return of step `t` that `learner` predicts.
    pub(crate) fn of(&self, learner: usize, t: usize) -> f64 {
        self.returns[self.columns[learner]][t]
    }

    /// Returns the prediction of `learner` at step `t`, given the value of its value function.
    pub(crate) fn prediction(&self, learner: usize, t: usize, value: f32) -> f32 {
        self.baselines[learner].map_or(value, |baseline| baseline[t] + value)
    }
}

/// Work between two checks for cancellation, in multiplications: about a second. A step that takes less is completed,
/// so that the state before the next one can be stored.
pub(crate) const WORK_PER_LOOK: u64 = 5_000_000_000;

/// Returns the total work per step of all learners.
pub(crate) fn work_per_step(learners: &[Learner<'_>], width: usize) -> u64 {
    let each = learners.iter().map(|learner| learner.work_per_step(width));
    each.fold(0, u64::saturating_add)
}

fn updates_per_look(learners: &[Learner<'_>], width: usize) -> usize {
    let each = learners.iter().map(|learner| learner.work_per_update(width));
    let of_update = each.fold(0, u64::saturating_add);
    usize::try_from(WORK_PER_LOOK / of_update.max(1)).unwrap_or(usize::MAX).max(1)
}

/// Agents that learn from the same mini-batches, each from its own parameters.
pub(crate) struct Population<'a> {
    task: Task<'a>,
    truth: &'a Truth<'a>,
    gamma: f64,
    updates_per_step: usize,
    /// Updates of a step between two checks of the monitor.
    updates_per_look: usize,
    values: Box<dyn Values>,
    replay: Option<Replay>,
    trackers: Vec<Tracker>,
    /// The next step.
    next: usize,
    /// Agents that have not diverged, and a buffer for the results of their updates.
    live: Vec<usize>,
    learned: Vec<Learned>,
    starts: Vec<usize>,
}

impl<'a> Population<'a> {
    /// Returns a population of learners that [`can_share`] with one another, with a tracker for each.
    pub(crate) fn new(
        task: Task<'a>,
        truth: &'a Truth<'a>,
        learners: &[Learner<'_>],
        trackers: Vec<Tracker>,
    ) -> Self {
        let shared = learners[0].config;
        let Task { stream, seed, steps } = task;
        let replay = Replay::of_agent(shared, seed, steps);
        let batch = shared.transitions_per_update();
        let values = values_of(learners, stream, batch, seed);
        Self {
            task,
            truth,
            gamma: shared.gamma,
            updates_per_step: shared.updates_per_step,
            updates_per_look: updates_per_look(learners, stream.width()),
            values,
            replay,
            trackers,
            next: 0,
            live: (0..learners.len()).collect(),
            learned: vec![Learned::default(); learners.len()],
            starts: vec![0; batch],
        }
    }

    /// Resumes at step `next` with these states of the agents before it. All other agents have diverged.
    pub(crate) fn resume<'s>(
        &mut self,
        next: usize,
        values: impl IntoIterator<Item = (usize, &'s ValueState)>,
    ) {
        self.next = next;
        self.live.clear();
        for (agent, state) in values {
            self.values.restore(agent, state);
            self.live.push(agent);
        }
        if let Some(replay) = &mut self.replay {
            let steps = self.task.course(self.gamma).map(|(t, _)| t);
            steps.take_while(|&t| t < next).for_each(|t| replay.push(t));
        }
    }

    /// Returns the present states of the agents that are still learning.
    pub(crate) fn values(&self) -> impl Iterator<Item = (usize, ValueState)> {
        self.live.iter().map(|&agent| (agent, self.values.state(agent)))
    }

    pub(crate) fn trackers(&self) -> &[Tracker] {
        &self.trackers
    }

    /// Trains over the rest of the run. `before` is called before each step and may end the run. The monitor may also
    /// end it within a step of many updates; that whole step is then repeated on resuming.
    pub(crate) fn run(
        &mut self,
        monitor: &dyn Monitor,
        mut before: impl FnMut(&Self, usize) -> Result<(), AgentError>,
    ) -> Result<(), AgentError> {
        let next = self.next;
        for (t, known) in self.task.course(self.gamma).skip_while(|&(t, _)| t < next) {
            if self.live.is_empty() {
                break;
            }
            before(self, t)?;
            self.step(t, known, monitor)?;
        }
        let last = self.task.steps.saturating_sub(1);
        for &agent in &self.live {
            if !self.values.is_finite(agent) {
                self.trackers[agent].diverged = Some(last);
            }
        }
        Ok(())
    }

    /// Predicts at step `t`, observes the next state, and learns.
    fn step(&mut self, t: usize, known: bool, monitor: &dyn Monitor) -> Result<(), AgentError> {
        let ready = match &mut self.replay {
            Some(replay) => {
                replay.push(t);
                replay.len() >= self.starts.len()
            }
            None => true,
        };
        if ready {
            for update in 0..self.updates_per_step {
                if update > 0 && update.is_multiple_of(self.updates_per_look) {
                    monitor.check()?;
                }
                self.update(t, update, known);
            }
        } else {
            let state = self.task.stream.state(t);
            for (learned, &agent) in self.learned.iter_mut().zip(&self.live) {
                let prediction = Some(self.values.predict(agent, state));
                *learned = Learned { prediction, squared_errors: 0.0, finite: true };
            }
            self.settle(t, known);
        }
        Ok(())
    }

    fn update(&mut self, t: usize, update: usize, known: bool) {
        match &self.replay {
            Some(replay) => replay.draw(t, update, &mut self.starts),
            None => self.starts.fill(t),
        }
        let batch = Batch {
            stream: self.task.stream,
            starts: &self.starts,
            present: (update == 0).then_some(t),
        };
        self.values.learn(batch, &self.live, &mut self.learned);
        for &agent in &self.live {
            self.trackers[agent].updates += 1;
        }
        self.settle(t, known);
    }

    /// Records the predictions of live agents, and drops those that diverged.
    fn settle(&mut self, t: usize, known: bool) {
        for (learned, &agent) in self.learned.iter().zip(&self.live) {
            let tracker = &mut self.trackers[agent];
            let prediction = learned.prediction.map(|value| self.truth.prediction(agent, t, value));
            if let Some(prediction) = prediction
                && known
                && prediction.is_finite()
            {
                tracker.record(t, prediction, self.truth.of(agent, t));
            }
            if !learned.finite || prediction.is_some_and(|value| !value.is_finite()) {
                tracker.diverged = Some(t);
            }
        }
        let trackers = &self.trackers;
        self.live.retain(|&agent| trackers[agent].diverged.is_none());
    }
}
