//! Training of many runs side by side, through an accelerator.

use calib_core::Monitor;

use crate::{
    Accelerator, AgentConfig, AgentError, AgentKind, Learner, Precision, Run, RunOutcome,
    ValueFunction, layer_sizes, parameter_count, population::can_share, train::grouped,
};

mod batch_slot;
mod cohort;

use cohort::Cohort;

/// The most runs that are trained side by side. More runs hardly make a GPU faster.
pub const MOST_TOGETHER: usize = 64;

/// Returns how many runs of `learners` fit into the memory of `accelerator` side by side: at least one, at most
/// [`MOST_TOGETHER`]. `states` and `width` are those of a run's stream.
pub fn runs_together(
    accelerator: &dyn Accelerator,
    learners: &[Learner<'_>],
    (states, width): (usize, usize),
) -> usize {
    let groups = groups(learners);
    let bytes = groups.iter().map(|group| {
        let config = learners[group[0]].config;
        group_bytes(config, group.len(), states, width)
    });
    let bytes = bytes.max().unwrap_or(1).max(1);
    let fits = usize::try_from(accelerator.memory() / bytes).unwrap_or(usize::MAX);
    fits.clamp(1, MOST_TOGETHER)
}

/// Returns the bytes per run for `learners` learners of one group, over a stream of `states` states of `width` values.
fn group_bytes(config: &AgentConfig, learners: usize, states: usize, width: usize) -> u64 {
    let seen = config.seen_width(width);
    let sizes = layer_sizes(config, seen);
    let rows = 2 * config.transitions_per_update() + 1;
    // Inputs of each layer, their gradients, and intermediate results.
    let activations = 3 * rows * sizes.iter().sum::<usize>();
    // Parameters, gradient, two moments, target network, and temporaries of an optimiser step.
    let parameters = 8 * parameter_count(config, seen);
    4 * (learners * (activations + parameters) + 2 * states * seen) as u64
}

/// Trains the same `learners` in every run, all side by side. Outcomes are listed run by run, in the order of the
/// learners.
///
/// Initial parameters, mini-batches and returns are the same as those of [`train_learners`](crate::train_learners). The
/// accelerator computes products and sums, so errors differ in their last digits, and by more where learning is about
/// to diverge. A run cannot be resumed in its middle. `monitor` advances by the steps of all runs.
///
/// # Errors
/// As [`train_learners`](crate::train_learners); if a value function is not a network in single precision; if the
/// accelerator fails.
pub fn train_together(
    runs: &[Run<'_>],
    learners: &[Learner<'_>],
    accelerator: &dyn Accelerator,
    monitor: &dyn Monitor,
) -> Result<Vec<Vec<RunOutcome>>, AgentError> {
    let Some(first) = runs.first() else { return Ok(Vec::new()) };
    for learner in learners {
        check_accelerated(learner.config)?;
    }
    for run in runs {
        let got = run.stream.width();
        let expected = first.stream.width();
        if got != expected {
            return Err(AgentError::Widths { got, expected });
        }
        run.check(learners)?;
    }
    let mut outcomes: Vec<Vec<Option<RunOutcome>>> = vec![vec![None; learners.len()]; runs.len()];
    let steps: u64 = runs.iter().map(|run| run.steps as u64).sum();
    let mut done = 0;
    let mut reported = 0;
    for group in groups(learners) {
        let own: Vec<Learner<'_>> = group.iter().map(|&place| learners[place]).collect();
        let mut cohort = Cohort::new(runs, &own)?;
        cohort.train(accelerator, |share| {
            let now = (done as f64 + share * group.len() as f64) / learners.len() as f64;
            let now = (now * steps as f64) as u64;
            monitor.advance(now.saturating_sub(reported));
            reported = reported.max(now);
            Ok(monitor.check()?)
        })?;
        done += group.len();
        for (outcomes, own) in outcomes.iter_mut().zip(cohort.outcomes()) {
            for (&place, outcome) in group.iter().zip(own) {
                outcomes[place] = Some(outcome);
            }
        }
    }
    monitor.advance(steps.saturating_sub(reported));
    Ok(outcomes.into_iter().map(|outcome| outcome.into_iter().flatten().collect()).collect())
}

/// Checks that an accelerator supports these agents: networks in single precision.
///
/// # Errors
/// [`AgentError::NotAccelerated`], with the setting that it does not support.
pub fn check_accelerated(config: &AgentConfig) -> Result<(), AgentError> {
    if config.kind != AgentKind::Td {
        return Err(AgentError::NotAccelerated("kind = \"external\""));
    }
    if config.baseline.is_some() {
        return Err(AgentError::NotAccelerated("a baseline"));
    }
    if config.halve_after > 0 {
        return Err(AgentError::NotAccelerated("halve_after"));
    }
    match (config.value_function, config.precision) {
        (ValueFunction::Mlp, Precision::F32) => Ok(()),
        (ValueFunction::Linear, _) => {
            Err(AgentError::NotAccelerated("value_function = \"linear\""))
        }
        (_, Precision::Bf16) => Err(AgentError::NotAccelerated("precision = \"bf16\"")),
    }
}

/// Groups learners that can share a population and have the same kind of optimiser.
fn groups(learners: &[Learner<'_>]) -> Vec<Vec<usize>> {
    grouped(learners, |a, b| can_share(a, b) && a.optimiser == b.optimiser)
}
