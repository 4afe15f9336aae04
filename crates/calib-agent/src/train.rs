use calib_core::{Monitor, Seed, Stream};

use crate::{
    AgentConfig, AgentError, Checkpointer, CurveRule, Learner, NoKeeper, RunOutcome, RunProgress,
    RunState,
    outcome::Tracker,
    population::{Population, Task, Truth, WORK_PER_LOOK, can_share, work_per_step},
    traces::TracedStream,
};

/// Steps between two updates of the monitor, unless they take long.
const STEPS_PER_LOOK: usize = 64;

/// Trains every agent on the same stream to predict the returns of state column `cumulant`.
///
/// At step t an agent predicts `v(s_t)`, which is recorded. Then it sees `s_{t+1}`, puts the transition into its
/// buffer and makes its updates. No transition and no return crosses from one unbroken piece of the stream into
/// the next. The result of an agent is to the byte that of training it alone. Agents share `seed`, hence initial
/// parameters (where shapes agree) and mini-batches (where batch size and buffer agree): the draw of an update
/// depends only on the seed, the step and the update's number in that step.
///
/// Outcomes come in the order of `agents`. `monitor` advances by the steps of the run in all, whatever the number
/// of agents. The caller begins the task.
///
/// # Errors
/// If a hyperparameter is outside its range, the cumulant is not a finite column of the stream, no step can be
/// scored, or the monitor is interrupted. Divergence is not an error but an outcome.
///
/// # Example
///
/// ```
/// use calib_agent::{AgentConfig, CurveRule, Part, ValueFunction, train};
/// use calib_core::{RowIndex, RowStream, Seed, Silent, States};
///
/// // A sensor that alternates between 0 and 1, seen by agents that discount by one half.
/// let states = States::new(vec![0.0, 1.0], 2, 1)?;
/// let stream = RowStream::unbroken(states, (0..4_000).map(|t| RowIndex::new(t % 2)).collect());
/// let agents = [1e-4, 1e-2].map(|learning_rate| AgentConfig {
///     value_function: ValueFunction::Linear,
///     gamma: 0.5,
///     batch_size: 32,
///     learning_rate,
///     ..AgentConfig::default()
/// });
/// let outcomes = train(&stream, 0, &agents, CurveRule::default(), Seed::new(1), &Silent)?;
/// let scores = outcomes.iter().map(|outcome| outcome.scores.of(Part::FinalQuarter).unwrap());
/// let settled: Vec<f64> = scores.map(|score| score.rmse).collect();
/// assert!(settled[1] < 1e-3 && settled[1] < settled[0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn train(
    stream: &dyn Stream,
    cumulant: usize,
    agents: &[AgentConfig],
    curve: CurveRule,
    seed: Seed,
    monitor: &dyn Monitor,
) -> Result<Vec<RunOutcome>, AgentError> {
    let learners: Vec<_> = agents.iter().map(|config| Learner::new(config, cumulant)).collect();
    let steps = stream.len().saturating_sub(1);
    train_learners(Run { stream, steps, curve, seed }, &learners, &NoKeeper, monitor)
}

/// The stream and settings that all learners of a run share.
#[derive(Clone, Copy)]
pub struct Run<'a> {
    /// The states that the learners see.
    pub stream: &'a dyn Stream,
    /// Steps of the run, fewer than the stream has states. States after the run complete the returns of its last
    /// steps, and are not learned from.
    pub steps: usize,
    /// How learning curves are sub-sampled.
    pub curve: CurveRule,
    /// Seed of initial parameters and mini-batches.
    pub seed: Seed,
}

impl Run<'_> {
    /// Checks that the stream is long enough, and that `learners` can learn from it.
    pub(crate) fn check(&self, learners: &[Learner<'_>]) -> Result<(), AgentError> {
        let Self { stream, steps, .. } = *self;
        if steps > 0 && steps >= stream.len() {
            return Err(AgentError::ShortStream { steps, states: stream.len() });
        }
        for learner in learners {
            learner.check(stream)?;
            check_cumulant(stream, learner.cumulant)?;
        }
        Ok(())
    }
}

/// Trains all `learners` of a run side by side; see [`train`].
///
/// Learners may predict different sensors and start from checkpoints. Where their other settings agree, they still
/// see the same mini-batches, which are gathered once. A learner with a learning rate of 0 costs one prediction
/// per step, and a diverged learner costs nothing further.
///
/// `keeper` receives a state whenever the work it asks for has been done since the last one. It also receives one
/// when the run is interrupted after an eighth of that. Work is counted in multiplications of matrix products,
/// four for each parameter and transition of a mini-batch. It is not counted in time, so that states are stored at
/// the same steps on every machine.
///
/// # Errors
/// As [`train`]; if a checkpoint does not fit its agent; if the keeper fails.
pub fn train_learners(
    run: Run<'_>,
    learners: &[Learner<'_>],
    keeper: &dyn Checkpointer,
    monitor: &dyn Monitor,
) -> Result<Vec<RunOutcome>, AgentError> {
    let Run { stream, steps, curve, seed } = run;
    run.check(learners)?;
    let task = Task { stream, steps, seed };
    let groups = populations(learners);
    let kept = keeper.load().filter(|kept| kept.progress.trackers.len() == learners.len());
    let finished = kept.as_ref().map_or(0, |kept| kept.progress.populations);
    let mut trackers = match &kept {
        Some(kept) => kept.progress.trackers.clone(),
        None => vec![Tracker::new(curve, steps); learners.len()],
    };
    let mut outcomes: Vec<Option<RunOutcome>> = vec![None; learners.len()];
    let mut progress = Progress { monitor, agents: learners.len() as u64, done: 0, reported: 0 };
    let mut work = 0_u64;
    let mut told = 0_u64;
    for (number, members) in groups.iter().enumerate() {
        let of_group: Vec<Learner<'_>> = members.iter().map(|&member| learners[member]).collect();
        let decays = &of_group[0].config.traces;
        let traced = (!decays.is_empty()).then(|| TracedStream::new(stream, decays));
        let seen = traced.as_ref().map_or(stream, |traced| traced as &dyn Stream);
        let task = Task { stream: seen, ..task };
        let truth = Truth::new(task, &of_group)?;
        let size = members.len() as u64;
        let before = progress.done;
        if number >= finished {
            let own = members.iter().map(|&member| trackers[member].clone()).collect();
            let mut population = Population::new(task, &truth, &of_group, own);
            if let Some(kept) = kept.as_ref().filter(|_| number == finished) {
                let values = kept.values.iter().filter_map(|(learner, values)| {
                    let place = members.iter().position(|member| member == learner)?;
                    Some((place, values))
                });
                population.resume(kept.progress.step, values);
            }
            let work_per_step = work_per_step(&of_group, stream.width());
            population.run(monitor, |population, step| {
                if step.is_multiple_of(STEPS_PER_LOOK) || told >= WORK_PER_LOOK {
                    progress.set(before + size * step as u64);
                    told = 0;
                }
                told = told.saturating_add(work_per_step);
                let checked = monitor.check();
                let enough = keeper.work_between() / if checked.is_err() { 8 } else { 1 };
                if work >= enough {
                    let mut trackers = trackers.clone();
                    for (&member, tracker) in members.iter().zip(population.trackers()) {
                        trackers[member] = tracker.clone();
                    }
                    let values =
                        population.values().map(|(agent, values)| (members[agent], values));
                    let progress = RunProgress { populations: number, step, trackers };
                    let state = RunState { progress, values: values.collect() };
                    keeper.keep(state).map_err(AgentError::Keep)?;
                    work = 0;
                }
                work = work.saturating_add(work_per_step);
                Ok(checked?)
            })?;
            for (&member, tracker) in members.iter().zip(population.trackers()) {
                trackers[member] = tracker.clone();
            }
        }
        progress.set(before + size * steps as u64);
        for (position, &member) in members.iter().enumerate() {
            let outcome = trackers[member].clone().outcome(|part| truth.scored(position, part));
            outcomes[member] = Some(outcome);
        }
    }
    Ok(outcomes.into_iter().flatten().collect())
}

/// Groups learners that can share a population.
pub(crate) fn populations(learners: &[Learner<'_>]) -> Vec<Vec<usize>> {
    grouped(learners, can_share)
}

/// Groups the positions of learners that are `alike`. The groups, and the positions in each, are in the order of
/// `learners`.
pub(crate) fn grouped(
    learners: &[Learner<'_>],
    alike: impl Fn(&AgentConfig, &AgentConfig) -> bool,
) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = vec![];
    for (index, learner) in learners.iter().enumerate() {
        match groups.iter_mut().find(|group| alike(learners[group[0]].config, learner.config)) {
            Some(group) => group.push(index),
            None => groups.push(vec![index]),
        }
    }
    groups
}

pub(crate) fn check_cumulant(stream: &dyn Stream, column: usize) -> Result<(), AgentError> {
    if column >= stream.width() {
        return Err(AgentError::Cumulant { got: column, width: stream.width() });
    }
    let mut values = (0..stream.len()).map(|step| (step, stream.state(step)[column]));
    match values.find(|(_, value)| !value.is_finite()) {
        None => Ok(()),
        Some((step, value)) => Err(AgentError::NonFiniteCumulant { column, step, value }),
    }
}

/// Counts completed agent-steps, and reports them to the monitor as steps of the stream.
struct Progress<'a> {
    monitor: &'a dyn Monitor,
    agents: u64,
    done: u64,
    reported: u64,
}

impl Progress<'_> {
    fn set(&mut self, done: u64) {
        self.done = done;
        let steps = done / self.agents;
        self.monitor.advance(steps - self.reported);
        self.reported = steps;
    }
}

#[cfg(test)]
pub(crate) mod tests;

#[cfg(test)]
mod baseline_tests;

#[cfg(test)]
mod side_by_side;
