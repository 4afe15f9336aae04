//! Values of the policies that settings learn from the log, estimated from the log alone. They are baselines that need no model.

use calib_core::{Cancelled, Monitor, States, TransitionIndex};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    Agent, AgentConfig, ControlError, Decisions, Ending, Importance, Outcome,
    evaluation::FittedQ,
    importance::{episodes, estimate, log_ratios},
};

/// The value of a setting's policy by fitted Q evaluation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FittedQValue {
    /// Mean value of the states in which episodes begin (`"-inf"` if it diverged).
    #[serde(with = "calib_stats::diverged")]
    #[schemars(with = "calib_stats::diverged::Stored")]
    pub value: f64,
    /// Number of passes over the log that were made.
    pub passes: usize,
    /// Whether the values had converged by then. Otherwise more passes would give another value.
    pub converged: bool,
    /// Whether rewards of the size of the recorded ones can add up to the value, give or take a tenth. Actions that the log hardly has in a state
    /// keep values near 0, and a policy that chooses them looks as if it got 0 there.
    pub possible: bool,
}

impl FittedQValue {
    /// Whether the values converged to one that no episode can have.
    pub fn is_impossible(&self) -> bool {
        self.converged && !self.possible
    }

    /// Largest number of passes over the log.
    pub const MOST_PASSES: usize = FittedQ::MOST_PASSES;

    /// Estimates the value of random actions, each as likely as any other. A pass takes as long as that for any other policy. `gamma` is
    /// the discount factor, and `timeout` the longest episode in steps.
    ///
    /// # Errors
    /// If the monitor interrupts.
    pub fn of_random_actions(
        log: &Decisions,
        starts: &States,
        gamma: f64,
        timeout: usize,
        monitor: &dyn Monitor,
    ) -> Result<Self, ControlError> {
        let [after, first] = [log.len(), starts.rows()]
            .map(|rows| vec![1.0 / log.levels() as f64; rows * log.levels()]);
        let mut fitted = FittedQ::fit(log, &after, gamma, timeout, monitor)?;
        let value = fitted.mean_over(starts, &first);
        Ok(Self::new(value, &fitted, &ReturnRange::new(log, gamma, timeout)))
    }

    /// Creates the record of fitted values whose mean over the start states is `value`.
    fn new(value: f64, fitted: &FittedQ, range: &ReturnRange) -> Self {
        Self {
            value: if value.is_finite() { value } else { f64::NEG_INFINITY },
            passes: fitted.passes(),
            converged: value.is_finite() && fitted.has_converged(),
            possible: value.is_finite() && range.has_about(value),
        }
    }
}

/// The discounted returns that episodes can have if every reward lies between the smallest and the largest recorded one.
struct ReturnRange {
    lowest: f64,
    highest: f64,
    /// The largest size of a reward.
    reward: f64,
}

impl ReturnRange {
    fn new(log: &Decisions, gamma: f64, timeout: usize) -> Self {
        let [least, largest] = log.reward_range();
        let steps = timeout as f64;
        let [shortest, longest] = if gamma < 1.0 {
            let discounted = (1.0 - gamma.powf(steps)) / (1.0 - gamma);
            [discounted, 1.0 / (1.0 - gamma)]
        } else {
            [steps, steps]
        };
        // A terminal may follow the first step.
        let shortest = if log.endings().contains(&Ending::Terminal) { 1.0 } else { shortest };
        Self {
            lowest: (least * shortest).min(least * longest),
            highest: (largest * shortest).max(largest * longest),
            reward: least.abs().max(largest.abs()),
        }
    }

    /// Whether `value` lies in the range, give or take a tenth of its ends and of a reward.
    fn has_about(&self, value: f64) -> bool {
        const SLACK: f64 = 0.1;
        value >= self.lowest - SLACK * (self.lowest.abs() + self.reward)
            && value <= self.highest + SLACK * (self.highest.abs() + self.reward)
    }
}

/// The values of all settings, estimated from the log alone.
#[derive(Clone, Debug, PartialEq)]
pub struct OffPolicyValues {
    /// Estimate by fitted Q evaluation, `[candidates]`.
    pub fitted_q: Vec<FittedQValue>,
    /// Estimate by weighted importance sampling, `[candidates]`; `None` without settings, or for a log without probabilities.
    pub importance: Option<Vec<Importance>>,
    /// Estimate by the weighted doubly robust estimator, `[candidates]`, on the same episodes; `None` where importance sampling is `None`.
    /// The value of a setting is `None` if importance sampling has no value for it, or if fitted Q evaluation diverged.
    pub doubly_robust: Option<Vec<Option<f64>>>,
}

/// The values of one setting.
struct CandidateValues {
    fitted_q: FittedQValue,
    /// Estimates that need the logged probabilities.
    sampled: Option<SampledValues>,
}

struct SampledValues {
    importance: Importance,
    doubly_robust: Option<f64>,
}

/// Estimates the value of each setting from the log alone: its agent learns from the recorded transitions, and its
/// policy is evaluated on them.
///
/// An agent learns from the log in its recorded order, in several passes until it has seen `updates` transitions. It has no traces,
/// because they would follow the behaviour instead of the agent. Its final policy π is evaluated in three ways:
///
/// - By fitted Q evaluation (Le, Voloshin & Yue 2019): the mean of Σ π(a | s) q̂(s, a) over the start states `starts`.
/// - By weighted per-decision importance sampling (Precup, Sutton & Singh 2000), if the probabilities of the recorded actions were logged:
///   the return of up to `timeout` steps from the beginnings of the recorded episodes.
/// - By the weighted doubly robust estimator (Jiang & Li 2016, Thomas & Brunskill 2016), under the same condition: the same return, with q̂ as control variate.
///
/// π and q̂ are learned from the same log, so the estimates are optimistic.
///
/// # Errors
/// If the monitor interrupts.
pub fn off_policy_values(
    log: &Decisions,
    starts: &States,
    candidates: &[AgentConfig],
    updates: usize,
    timeout: usize,
    monitor: &dyn Monitor,
) -> Result<OffPolicyValues, ControlError> {
    monitor.begin("evaluation by the log alone", candidates.len() as u64);
    let values: Result<Vec<CandidateValues>, Cancelled> = candidates
        .par_iter()
        .map(|&config| {
            monitor.check()?;
            let values = candidate_values(log, starts, config, updates, timeout, monitor)?;
            monitor.advance(1);
            Ok(values)
        })
        .collect();
    let mut all = OffPolicyValues { fitted_q: Vec::new(), importance: None, doubly_robust: None };
    for CandidateValues { fitted_q, sampled } in values? {
        all.fitted_q.push(fitted_q);
        if let Some(SampledValues { importance, doubly_robust }) = sampled {
            all.importance.get_or_insert_default().push(importance);
            all.doubly_robust.get_or_insert_default().push(doubly_robust);
        }
    }
    Ok(all)
}

/// Returns the memory of [`off_policy_values`] for one setting at a time, without that of the agent, in bytes.
pub fn off_policy_bytes(log: &Decisions) -> u64 {
    let weights = FittedQ::bytes(log.states().columns(), log.levels());
    // The values are a probability per transition and action, and a fitted value per transition. With logged probabilities, each transition
    // later has a ratio, its copy in the episode, and two fitted values instead.
    let per_transition = log.levels() + if log.probabilities().is_some() { 4 } else { 1 };
    weights + (log.len() * per_transition * size_of::<f64>()) as u64
}

fn candidate_values(
    log: &Decisions,
    starts: &States,
    config: AgentConfig,
    updates: usize,
    timeout: usize,
    monitor: &dyn Monitor,
) -> Result<CandidateValues, Cancelled> {
    let agent = &mut trained_on_log(log, config, updates);
    let gamma = config.gamma;
    let transitions = (0..log.len()).map(TransitionIndex::new);
    let after = policies(agent, transitions.clone().map(|at| log.ends(at)[1]));
    let mut fitted = FittedQ::fit(log, &after, gamma, timeout, monitor)?;
    // `after` has a number per transition and action, and so has `here`.
    drop(after);
    let first = policies(agent, (0..starts.rows()).map(|row| starts.row(row)));
    let value = fitted.mean_over(starts, &first);
    let sampled = log.probabilities().map(|logged| {
        let here = policies(agent, transitions.map(|at| log.ends(at)[0]));
        let ratios = log_ratios(log, logged, &here);
        let importance = estimate(&episodes(log, &ratios, &[]), gamma, timeout);
        let doubly_robust = if value.is_finite() {
            let values = fitted.at_steps(log, &here);
            let found = estimate(&episodes(log, &ratios, &values), gamma, timeout).value;
            found.filter(|found| found.is_finite())
        } else {
            None
        };
        SampledValues { importance, doubly_robust }
    });
    let range = ReturnRange::new(log, gamma, timeout);
    Ok(CandidateValues { fitted_q: FittedQValue::new(value, &fitted, &range), sampled })
}

/// Returns an agent that learned from `updates` recorded transitions.
fn trained_on_log(log: &Decisions, config: AgentConfig, updates: usize) -> Agent {
    let config = AgentConfig { lambda: 0.0, ..config };
    let mut agent = Agent::new(config, log.states().columns(), log.levels());
    let mut before = None;
    for update in 0..updates {
        let number = update % log.len();
        let transition = TransitionIndex::new(number);
        let source = log.transitions().source(transition);
        if before != Some(source) {
            agent.look(log.states().row(source.get()));
        }
        let next = log.transitions().next(transition);
        let reward = f64::from(log.rewards()[number]);
        let outcome = Outcome { reward, ending: log.endings()[number] };
        agent.learn(usize::from(log.actions()[number]), outcome, log.states().row(next.get()));
        before = Some(next);
    }
    agent
}

/// Returns π(· | state) of each of `states`, one after the other.
fn policies<'a>(agent: &mut Agent, states: impl Iterator<Item = &'a [f32]>) -> Vec<f64> {
    // A growing vector would take up to three times as much memory for a moment.
    let mut all = Vec::with_capacity(states.size_hint().0 * agent.actions());
    for state in states {
        agent.go_on(state);
        all.extend_from_slice(agent.policy());
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::tests::corridor;

    #[test]
    fn values_that_no_episode_can_have_are_impossible() {
        // Every step gets -1, and a terminal may follow the first one.
        let log = corridor();
        let range = ReturnRange::new(&log, 0.95, 100);
        let possible = [-19.9, -5.0, -1.0].map(|value| range.has_about(value));
        assert_eq!(possible, [true; 3], "up to 20 discounted steps");
        assert_eq!([-30.0, -0.5, 3.0].map(|value| range.has_about(value)), [false; 3]);
        let undiscounted = ReturnRange::new(&log, 1.0, 100);
        assert!(undiscounted.has_about(-100.0) && !undiscounted.has_about(-120.0));
    }
}
