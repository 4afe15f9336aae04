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

/// The value functions of learners of one kind and shape, as they start, for batches of up to `batch` transitions of a stream.
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

/// What agents must share to learn in lockstep: what they see, the shape and precision of the value function, γ, whether there are
/// target networks, and everything that decides which transitions an update sees.
pub(crate) fn can_share(a: &AgentConfig, b: &AgentConfig) -> bool {
    a.traces == b.traces
        && a.optimiser.has_traces() == b.optimiser.has_traces()
        && network_shape(a) == network_shape(b)
        && replay_sizes(a) == replay_sizes(b)
        && a.gamma == b.gamma
        && a.updates_per_step == b.updates_per_step
        && (a.target_network_period > 0) == (b.target_network_period > 0)
}

/// Hidden layers, units of each, and precision; none without a network.
fn network_shape(config: &AgentConfig) -> Option<(usize, usize, Precision)> {
    match config.value_function {
        ValueFunction::Mlp => Some((config.hidden_layers, config.hidden_units, config.precision)),
        ValueFunction::Linear => None,
    }
}

/// Transitions that are kept, and those of a mini-batch; none without replay.
fn replay_sizes(config: &AgentConfig) -> Option<(usize, usize)> {
    match config.replay {
        ReplayKind::Uniform => Some((config.replay_capacity, config.batch_size)),
        ReplayKind::None => None,
    }
}

/// What a population is trained on and held to.
#[derive(Clone, Copy)]
pub(crate) struct Task<'a> {
    /// At least one state longer than the run: what follows only completes returns.
    pub(crate) stream: &'a dyn Stream,
    pub(crate) steps: usize,
    pub(crate) seed: Seed,
}

impl<'a> Task<'a> {
    /// The steps that are made, in order, and whether their returns by `gamma` are known. No step leads from one piece into the next.
    pub(crate) fn course(self, gamma: f64) -> impl Iterator<Item = (usize, bool)> + use<'a> {
        self.stream.pieces().iter().flat_map(move |piece| {
            let known = known_returns(piece, gamma);
            let steps = piece.start..piece.end.saturating_sub(1).min(self.steps);
            steps.map(move |t| (t, known.contains(&t)))
        })
    }
}

/// The returns that the predictions of a population are held to, for each column that it predicts.
pub(crate) struct Truth<'a> {
    /// The column of each learner, by its place among the returns.
    columns: Vec<usize>,
    /// What each learner's value function is added to.
    baselines: Vec<Option<&'a [f32]>>,
    returns: Vec<Vec<f64>>,
    /// Statistics of the returns of each column, part by part.
    scored: Vec<[Option<ScoredReturns>; Part::ALL.len()]>,
}

impl<'a> Truth<'a> {
    /// For learners that [`can_share`] with one another.
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

    /// Statistics of the returns that `learner` predicts in one part of the run.
    pub(crate) fn scored(&self, learner: usize, part: Part) -> Option<ScoredReturns> {
        self.scored[self.columns[learner]][part as usize]
    }

    /// The return of step `t` that `learner` predicts.
    pub(crate) fn of(&self, learner: usize, t: usize) -> f64 {
        self.returns[self.columns[learner]][t]
    }

    /// What `learner` predicts at step `t`, where its value function has this value.
    pub(crate) fn prediction(&self, learner: usize, t: usize, value: f32) -> f32 {
        self.baselines[learner].map_or(value, |baseline| baseline[t] + value)
    }
}

/// Work after which somebody looks whether a run is to stop, in multiplications: about a second. A step that takes less
/// is made to its end, so that the state before the next one can be kept.
pub(crate) const WORK_PER_LOOK: u64 = 5_000_000_000;

/// Work of a step of all of them.
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
    /// Updates of a step between two looks at the monitor.
    updates_per_look: usize,
    values: Box<dyn Values>,
    replay: Option<Replay>,
    trackers: Vec<Tracker>,
    /// The first step that is still to be made.
    next: usize,
    /// Agents that have not diverged, and room for what they learned.
    live: Vec<usize>,
    learned: Vec<Learned>,
    starts: Vec<usize>,
}

impl<'a> Population<'a> {
    /// Learners that [`can_share`] with one another, with a tracker for each.
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

    /// Go on at step `next`, before which these agents were left like this; the others have diverged.
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

    /// Agents that are still learning, as they stand.
    pub(crate) fn values(&self) -> impl Iterator<Item = (usize, ValueState)> {
        self.live.iter().map(|&agent| (agent, self.values.state(agent)))
    }

    pub(crate) fn trackers(&self) -> &[Tracker] {
        &self.trackers
    }

    /// Train over the rest of the run. `before` is called before each step and may end the run; so may the monitor, also within a
    /// step of many updates, which is then made again as a whole.
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

    /// Predict at step `t`, see the next state, learn.
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

    /// Record what live agents predicted, and drop those that diverged.
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
