//! Policies that learn nothing: always the same action, and random actions. Every agent has to beat them.

use calib_core::{Monitor, Rng, Seed};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::{
    ActionModelKind, ControlError, Coverage, Ensemble, ModelEnvironment as _, Outcome, RunBudget,
    RunLength,
    agent_run::{Actor, Episodes},
    sweep::run_seed,
};

/// The results of constant actions and of random actions in the ensemble members of one kind of model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ConstantReturns {
    /// The kind of model.
    pub kind: ActionModelKind,
    /// Mean return per episode of each action, over its rollouts in each member, `[members][actions]`.
    pub members: Vec<Vec<f64>>,
    /// Mean return per episode of random actions, over their rollouts in each member.
    pub random: Vec<f64>,
    /// Coverage of the steps with each action, over members and rollouts.
    pub coverage: Vec<Coverage>,
}

/// A policy that learns nothing.
#[derive(Clone, Copy, Debug)]
pub enum FixedPolicy {
    /// One action in every state.
    Constant(usize),
    /// Each of this many actions with the same probability.
    Random(usize),
}

impl Actor for FixedPolicy {
    fn look(&mut self, _state: &[f32]) {}

    fn act(&mut self, rng: &mut Rng) -> Option<usize> {
        Some(match *self {
            Self::Constant(action) => action,
            Self::Random(actions) => rng.below(actions),
        })
    }

    fn learn(&mut self, _action: usize, _outcome: Outcome, _next: &[f32]) {}
}

/// Number of full-length episodes of random actions in each ensemble member, if the rollouts suffice. It gives their mean to a tenth of the
/// spread between episodes. Our choice.
const RANDOM_EPISODES: usize = 100;

/// The most rollouts for these episodes in each ensemble member. Our choice.
const MOST_ROLLOUTS: usize = 32;

/// Number of rollouts of policies that learn nothing, in each ensemble member.
///
/// An agent has as many runs as a study asks for. One rollout of random actions is so noisy that it would decide by chance which agent is
/// better. Among several constant actions the luckiest one would look best.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FixedRollouts {
    /// Rollouts of random actions.
    pub random: usize,
    /// Rollouts of each constant action. All constant actions together have about as many as random actions.
    pub constant: usize,
}

impl FixedRollouts {
    /// Returns the numbers for `actions` actions, beside agents that have `runs` runs of length `span`.
    pub fn new(runs: usize, span: RunLength, actions: usize) -> Self {
        let steps = span.steps.max(1);
        let episode = span.timeout.clamp(1, steps);
        let enough = RANDOM_EPISODES.saturating_mul(episode).div_ceil(steps).min(MOST_ROLLOUTS);
        Self { random: enough.max(runs), constant: enough.div_ceil(actions.max(1)).max(runs) }
    }

    /// Returns the number of rollouts in one ensemble member.
    pub fn in_member(self, actions: usize) -> usize {
        self.constant.saturating_mul(actions).saturating_add(self.random)
    }
}

/// The result of one rollout.
#[derive(Clone, Copy, Debug)]
struct RolloutResult {
    mean_return: f64,
    coverage: Coverage,
}

/// Rolls out each constant action, and random actions, in every ensemble member. Rollouts are as long as the runs of agents in
/// [`sweep`](crate::sweep), and the first ones have the same random numbers as these runs. [`FixedRollouts`] gives their numbers.
///
/// # Errors
/// If the monitor interrupts.
pub fn constant_returns<M: Ensemble>(
    model: &M,
    actions: usize,
    budget: RunBudget,
    seed: Seed,
    monitor: &dyn Monitor,
) -> Result<ConstantReturns, ControlError> {
    let RunBudget { runs, span } = budget;
    let numbers = FixedRollouts::new(runs, span, actions);
    let in_member = numbers.in_member(actions);
    let of_constants = actions * numbers.constant;
    let units = model.members() * in_member;
    monitor.begin("constant and random actions", units as u64);
    let results = (0..units).into_par_iter().map(|unit| -> Result<_, ControlError> {
        monitor.check()?;
        let member = unit / in_member;
        let place = unit % in_member;
        let (mut policy, run) = match place.checked_sub(of_constants) {
            Some(run) => (FixedPolicy::Random(actions), run),
            None => (FixedPolicy::Constant(place / numbers.constant), place % numbers.constant),
        };
        let mut rollout = model.rollout(member);
        let mut episodes = Episodes::new(&rollout, span, run_seed(seed, member, run));
        while episodes.step(&mut policy, &mut rollout) {}
        monitor.advance(1);
        Ok(RolloutResult { mean_return: episodes.run.mean_return(), coverage: rollout.coverage() })
    });
    let results: Vec<RolloutResult> = results.collect::<Result<_, _>>()?;
    let mut all = ConstantReturns {
        kind: model.kind(),
        members: Vec::with_capacity(model.members()),
        random: Vec::with_capacity(model.members()),
        coverage: vec![Coverage::default(); actions],
    };
    for of_member in results.chunks(in_member) {
        let (constant, random) = of_member.split_at(of_constants);
        all.random.push(mean_return(random));
        all.members.push(constant.chunks(numbers.constant).map(mean_return).collect());
        for (coverage, own) in all.coverage.iter_mut().zip(constant.chunks(numbers.constant)) {
            *coverage = own.iter().fold(*coverage, |sum, rollout| sum.and(rollout.coverage));
        }
    }
    Ok(all)
}

/// Returns the mean return over rollouts.
fn mean_return(rollouts: &[RolloutResult]) -> f64 {
    rollouts.iter().map(|rollout| rollout.mean_return).sum::<f64>() / rollouts.len() as f64
}

#[cfg(test)]
mod tests {
    use calib_core::Silent;

    use super::*;
    use crate::{ActionModel, ActionModelConfig, evaluation::tests::corridor, model::tests::built};

    /// Returns a model of two ensemble members, in which episodes begin in the first recorded state.
    fn corridor_model() -> ActionModel {
        let config = ActionModelConfig { members: 2, ..ActionModelConfig::default() };
        built(corridor(), 1, &config, 0.0)
    }

    #[test]
    fn only_the_action_that_leads_to_the_end_gets_there() {
        let model = corridor_model();
        let budget = RunBudget { runs: 2, span: RunLength { steps: 200, timeout: 20 } };
        let found = constant_returns(&model, 2, budget, Seed::new(3), &Silent).expect("rolled out");
        assert_eq!((found.kind, found.members.len()), (ActionModelKind::Neighbors, 2));
        for member in &found.members {
            // The reward is −1 per step: to the left an episode is cut after 20 steps.
            assert!(member[0] == -20.0 && member[1] > -12.0, "{member:?}");
        }
        for (random, member) in found.random.iter().zip(&found.members) {
            assert!(-20.0 <= *random && *random < member[1], "{found:?}");
        }
        // A hundred episodes of 20 steps are ten rollouts of 200 steps of random actions, and as many of both constant actions together.
        let numbers = FixedRollouts::new(2, budget.span, 2);
        assert_eq!(numbers, FixedRollouts { random: 10, constant: 5 });
        assert_eq!(found.coverage[0].steps, 2 * 5 * 200);
        let again = constant_returns(&model, 2, budget, Seed::new(3), &Silent).expect("rolled out");
        assert_eq!(found, again);
    }

    /// Returns the numbers of rollouts of random actions, and of each constant action.
    fn rollouts(runs: usize, steps: usize, timeout: usize, actions: usize) -> [usize; 2] {
        let FixedRollouts { random, constant } =
            FixedRollouts::new(runs, RunLength { steps, timeout }, actions);
        [random, constant]
    }

    #[test]
    fn rollouts_are_as_many_as_tell_what_an_episode_gets() {
        assert_eq!(rollouts(1, 300, 50, 3), [17, 6]);
        assert_eq!(rollouts(1, 15_000, 500, 2), [4, 2]);
        assert_eq!(rollouts(1, 50, 500, 2), [32, 16], "no more than so many");
        assert_eq!(
            rollouts(1, 1_000, 500, 64),
            [32, 1],
            "of many actions each has the runs of agents"
        );
        assert_eq!(rollouts(40, 50, 500, 2), [40, 40], "no fewer than agents have");
        assert_eq!(rollouts(1, 1_000_000, 10, 2), [1, 1]);
        let span = RunLength { steps: 300, timeout: 50 };
        assert_eq!(FixedRollouts::new(1, span, 3).in_member(3), 35);
    }

    /// Returns the sum of squared distances from the mean.
    fn spread(returns: &[f64]) -> f64 {
        let mean = returns.iter().sum::<f64>() / returns.len() as f64;
        returns.iter().map(|value| (value - mean).powi(2)).sum::<f64>()
    }

    #[test]
    fn noise_of_rollouts_is_small_beside_that_of_one() {
        let model = corridor_model();
        // Each rollout has about one episode.
        let budget = RunBudget { runs: 1, span: RunLength { steps: 60, timeout: 60 } };
        let (mut of_all, mut of_one) = (Vec::new(), Vec::new());
        for number in 0..20 {
            let seed = Seed::new(number);
            let found = constant_returns(&model, 2, budget, seed, &Silent).expect("rolled out");
            of_all.push(found.random[0]);
            let mut rollout = model.rollout(0);
            let mut episodes = Episodes::new(&rollout, budget.span, run_seed(seed, 0, 0));
            while episodes.step(&mut FixedPolicy::Random(2), &mut rollout) {}
            of_one.push(episodes.run.mean_return());
        }
        let (many, alone) = (spread(&of_all), spread(&of_one));
        assert!(alone > 0.0 && many < alone / 8.0, "{many} {alone}");
    }
}
