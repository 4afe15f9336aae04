use calib_core::{Monitor, Seed, Stream};

use crate::{
    AgentConfig, AgentError, CurveRule, RunOutcome, Scoring,
    population::{Population, Task, can_share},
};

/// Steps between looks at the monitor.
const STEPS_PER_LOOK: usize = 64;

/// Train every agent on the same stream to predict the returns of state column `cumulant`.
///
/// At step t an agent predicts `v(s_t)`, which is recorded; then it sees `s_{t+1}`, puts the transition into
/// its buffer and makes its updates. No transition and no return crosses from one unbroken piece of the
/// stream into the next. The result of an agent is to the byte that of training it alone: agents share
/// `seed`, hence initial parameters (where shapes agree) and mini-batches (where batch size and buffer
/// agree): the draw of an update depends only on the seed, the step and the update's number in that step.
///
/// Outcomes come in the order of `agents`. `monitor` advances by the stream's length in all, whatever the
/// number of agents; the caller begins the task.
///
/// # Errors
/// If a hyperparameter is outside its range, the cumulant is not a finite column of the stream, no step
/// can be scored, or the monitor is interrupted. Divergence is not an error but an outcome.
///
/// # Example
///
/// ```
/// use calib_agent::{AgentConfig, CurveRule, Scoring, ValueFunction, train};
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
/// let (scoring, curve) = (Scoring::Final(0.25), CurveRule::default());
/// let outcomes = train(&stream, 0, &agents, scoring, curve, Seed::new(1), &Silent)?;
/// assert!(outcomes[1].nrmse < 1e-3 && outcomes[1].nrmse < outcomes[0].nrmse);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn train(
    stream: &dyn Stream,
    cumulant: usize,
    agents: &[AgentConfig],
    scoring: Scoring,
    curve: CurveRule,
    seed: Seed,
    monitor: &dyn Monitor,
) -> Result<Vec<RunOutcome>, AgentError> {
    agents.iter().try_for_each(AgentConfig::check)?;
    check_cumulant(stream, cumulant)?;
    let task =
        Task { stream, cumulant, first_scored: scoring.first_step(stream.len())?, curve, seed };
    let mut progress = Progress { monitor, agents: agents.len() as u64, done: 0, reported: 0 };
    let mut outcomes: Vec<Option<RunOutcome>> = vec![None; agents.len()];
    for members in populations(agents) {
        let configs: Vec<&AgentConfig> = members.iter().map(|&member| &agents[member]).collect();
        let size = members.len() as u64;
        let before = progress.done;
        let trained = Population::new(task, &configs)?.run(|t| {
            if t.is_multiple_of(STEPS_PER_LOOK) {
                progress.set(before + size * t as u64);
                if monitor.interrupted() {
                    return Err(AgentError::Interrupted);
                }
            }
            Ok(())
        })?;
        progress.set(before + size * stream.len() as u64);
        for (member, outcome) in members.into_iter().zip(trained) {
            outcomes[member] = Some(outcome);
        }
    }
    Ok(outcomes.into_iter().flatten().collect())
}

/// Agents grouped by what they can share, each group and the groups in the order of `agents`.
fn populations(agents: &[AgentConfig]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = vec![];
    for (index, agent) in agents.iter().enumerate() {
        let fits = |group: &&mut Vec<usize>| can_share(&agents[group[0]], agent);
        match groups.iter_mut().find(fits) {
            Some(group) => group.push(index),
            None => groups.push(vec![index]),
        }
    }
    groups
}

fn check_cumulant(stream: &dyn Stream, column: usize) -> Result<(), AgentError> {
    if column >= stream.width() {
        return Err(AgentError::Cumulant { got: column, width: stream.width() });
    }
    let value = |step: usize| stream.state(step)[column];
    match (0..stream.len()).find(|&step| !value(step).is_finite()) {
        None => Ok(()),
        Some(step) => Err(AgentError::NonFiniteCumulant { column, step, value: value(step) }),
    }
}

/// Agent-steps done, told to the monitor as steps of the stream.
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
mod tests;
