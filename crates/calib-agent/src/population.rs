use calib_core::{Seed, Stream};

use crate::{
    AgentConfig, AgentError, CurveRule, ReplayKind, RunOutcome, ValueFunction,
    linear::LinearValues,
    mlp::MlpValues,
    outcome::Tracker,
    replay::Replay,
    returns::discounted_returns,
    scoring::{ScoredReturns, known_returns},
    values::{Batch, Learned, Values},
};

/// What agents must share to learn in lockstep: the shape of the value function, γ, whether there are
/// target networks, and everything that decides which transitions an update sees.
pub(crate) fn can_share(a: &AgentConfig, b: &AgentConfig) -> bool {
    let shape = |config: &AgentConfig| match config.value_function {
        ValueFunction::Mlp => Some((config.hidden_layers, config.hidden_units)),
        ValueFunction::Linear => None,
    };
    let draws = |config: &AgentConfig| match config.replay {
        ReplayKind::Uniform => Some((config.replay_capacity, config.batch_size)),
        ReplayKind::None => None,
    };
    shape(a) == shape(b)
        && draws(a) == draws(b)
        && a.gamma == b.gamma
        && a.updates_per_step == b.updates_per_step
        && (a.target_network_period > 0) == (b.target_network_period > 0)
}

/// One task for one population: which stream, which sensor, what is scored.
#[derive(Clone, Copy)]
pub(crate) struct Task<'a> {
    pub(crate) stream: &'a dyn Stream,
    pub(crate) cumulant: usize,
    pub(crate) first_scored: usize,
    pub(crate) curve: CurveRule,
    pub(crate) seed: Seed,
}

/// Agents that learn from the same mini-batches, each from its own parameters.
pub(crate) struct Population<'a> {
    task: Task<'a>,
    gamma: f64,
    updates_per_step: usize,
    values: Box<dyn Values>,
    replay: Option<Replay>,
    returns: Vec<f64>,
    scored: ScoredReturns,
    trackers: Vec<Tracker>,
    /// Agents that have not diverged, and room for what they learned.
    live: Vec<usize>,
    learned: Vec<Learned>,
    starts: Vec<usize>,
}

impl<'a> Population<'a> {
    /// Agents that [`can_share`] with one another.
    pub(crate) fn new(task: Task<'a>, configs: &[&AgentConfig]) -> Result<Self, AgentError> {
        let shared = configs[0];
        let Task { stream, seed, .. } = task;
        let (steps, pieces) = (stream.len(), stream.pieces());
        let returns = discounted_returns(stream, task.cumulant, shared.gamma);
        let scored = ScoredReturns::new(&returns, pieces, shared.gamma, task.first_scored)?;
        let (replay, batch) = match shared.replay {
            ReplayKind::Uniform => {
                let seed = seed.child("replay");
                let replay = Replay::new(seed, shared.replay_capacity, steps);
                (Some(replay), shared.batch_size)
            }
            ReplayKind::None => (None, 1),
        };
        let width = stream.width();
        let values: Box<dyn Values> = match shared.value_function {
            ValueFunction::Mlp => Box::new(MlpValues::new(configs, width, batch, seed)),
            ValueFunction::Linear => Box::new(LinearValues::new(configs, width, seed)),
        };
        Ok(Self {
            task,
            gamma: shared.gamma,
            updates_per_step: shared.updates_per_step,
            values,
            replay,
            returns,
            scored,
            trackers: vec![Tracker::new(task.curve, steps); configs.len()],
            live: (0..configs.len()).collect(),
            learned: vec![Learned::default(); configs.len()],
            starts: vec![0; batch],
        })
    }

    /// Train over the whole stream. `tick` is called with each step and may end the run.
    pub(crate) fn run(
        mut self,
        mut tick: impl FnMut(usize) -> Result<(), AgentError>,
    ) -> Result<Vec<RunOutcome>, AgentError> {
        let stream = self.task.stream;
        for piece in stream.pieces() {
            let known = known_returns(piece, self.gamma);
            for t in piece.start..piece.end.saturating_sub(1) {
                if self.live.is_empty() {
                    break;
                }
                tick(t)?;
                self.step(t, known.contains(&t));
            }
        }
        let last = stream.len().saturating_sub(1);
        for &agent in &self.live {
            if !self.values.is_finite(agent) {
                self.trackers[agent].diverged = Some(last);
            }
        }
        let outcome = |tracker: Tracker| tracker.outcome(self.scored, stream.len());
        Ok(self.trackers.into_iter().map(outcome).collect())
    }

    /// Predict at step `t`, see the next state, learn.
    fn step(&mut self, t: usize, known: bool) {
        let ready = match &mut self.replay {
            Some(replay) => {
                replay.push(t);
                replay.len() >= self.starts.len()
            }
            None => true,
        };
        if ready {
            for update in 0..self.updates_per_step {
                self.update(t, update, known);
            }
        } else {
            let state = self.task.stream.state(t);
            for (learned, &agent) in self.learned.iter_mut().zip(&self.live) {
                *learned =
                    Learned { prediction: Some(self.values.predict(agent, state)), finite: true };
            }
            self.settle(t, known);
        }
    }

    fn update(&mut self, t: usize, update: usize, known: bool) {
        match &self.replay {
            Some(replay) => replay.draw(t, update, &mut self.starts),
            None => self.starts.fill(t),
        }
        let batch = Batch {
            stream: self.task.stream,
            cumulant: self.task.cumulant,
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
        let scored = t >= self.task.first_scored;
        for (learned, &agent) in self.learned.iter().zip(&self.live) {
            let tracker = &mut self.trackers[agent];
            if let Some(prediction) = learned.prediction
                && known
                && prediction.is_finite()
            {
                tracker.record(t, prediction, self.returns[t], scored);
            }
            if !learned.finite || learned.prediction.is_some_and(|value| !value.is_finite()) {
                tracker.diverged = Some(t);
            }
        }
        let trackers = &self.trackers;
        self.live.retain(|&agent| trackers[agent].diverged.is_none());
    }
}
