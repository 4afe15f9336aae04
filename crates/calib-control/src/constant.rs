//! Policies that learn nothing, which every agent has to beat: always the same action, and actions at random.

use calib_core::{Monitor, Rng, Seed};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::{
    ActionModelKind, ControlError, Coverage, Ensemble, Extent, ModelEnvironment as _, Outcome,
    agent_run::{Actor, Episodes},
    sweep::run_seed,
};

/// What comes of taking one action for ever, and of actions at random, in the members of one kind of model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ConstantReturns {
    /// What the members are.
    pub kind: ActionModelKind,
    /// Mean return an episode of each action over the runs of each member, `[members][actions]`.
    pub members: Vec<Vec<f64>>,
    /// Mean return an episode of actions at random over the runs of each member.
    pub random: Vec<f64>,
    /// What the steps with each action rested on, over members and runs.
    pub coverage: Vec<Coverage>,
}

/// A policy that learns nothing.
#[derive(Clone, Copy, Debug)]
pub enum FixedPolicy {
    /// One action in every state.
    Constant(usize),
    /// Each of so many actions equally often.
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

/// Take each of `actions` actions for ever in every member, and actions at random, in as many and as long runs as agents have in [`sweep`](crate::sweep), which
/// meet the same chance.
///
/// # Errors
/// If the monitor interrupts.
pub fn constant_returns<M: Ensemble>(
    model: &M,
    actions: usize,
    extent: Extent,
    seed: Seed,
    monitor: &dyn Monitor,
) -> Result<ConstantReturns, ControlError> {
    let policies = actions + 1;
    let units = model.members() * policies;
    monitor.begin("constant and random actions", units as u64);
    let results = (0..units).into_par_iter().map(|unit| -> Result<_, ControlError> {
        let member = unit / policies;
        let action = unit % policies;
        let mut policy = if action == actions {
            FixedPolicy::Random(actions)
        } else {
            FixedPolicy::Constant(action)
        };
        let mut sum = 0.0;
        let mut coverage = Coverage::default();
        for run in 0..extent.runs {
            monitor.check()?;
            let seed = run_seed(seed, member, run);
            let mut walk = model.walk(member);
            let mut episodes = Episodes::new(&walk, extent.span, seed);
            while episodes.step(&mut policy, &mut walk) {}
            sum += episodes.run.mean_return();
            coverage = coverage.and(walk.coverage());
        }
        monitor.advance(1);
        Ok((sum / extent.runs as f64, coverage))
    });
    let results: Vec<(f64, Coverage)> = results.collect::<Result<_, _>>()?;
    let mut all = ConstantReturns {
        kind: model.kind(),
        members: Vec::with_capacity(model.members()),
        random: Vec::with_capacity(model.members()),
        coverage: vec![Coverage::default(); actions],
    };
    for of_member in results.chunks(policies) {
        let (of_member, random) = of_member.split_at(actions);
        all.random.extend(random.iter().map(|&(mean_return, _)| mean_return));
        all.members.push(of_member.iter().map(|&(mean_return, _)| mean_return).collect());
        for (coverage, &(_, own)) in all.coverage.iter_mut().zip(of_member) {
            *coverage = coverage.and(own);
        }
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use calib_core::Silent;

    use super::*;
    use crate::{ActionModel, ActionModelConfig, RunLength, Starts, evaluation::tests::corridor};

    #[test]
    fn only_the_action_that_leads_to_the_end_gets_there() {
        let log = corridor();
        let metric = log.states().clone();
        let starts = Starts { observed: metric.slice(0..1), metric: metric.slice(0..1) };
        let config = ActionModelConfig { members: 2, ..ActionModelConfig::default() };
        let model = ActionModel::build(log, &metric, starts, &config, 0.0, &Silent).expect("built");
        let extent = Extent { runs: 2, span: RunLength { steps: 200, timeout: 20 } };
        let found = constant_returns(&model, 2, extent, Seed::new(3), &Silent).expect("walked");
        assert_eq!((found.kind, found.members.len()), (ActionModelKind::Neighbors, 2));
        for member in &found.members {
            // -1 a step: to the left an episode is cut after 20.
            assert!(member[0] == -20.0 && member[1] > -12.0, "{member:?}");
        }
        for (random, member) in found.random.iter().zip(&found.members) {
            assert!(-20.0 <= *random && *random < member[1], "{found:?}");
        }
        assert_eq!(found.coverage[0].steps, 2 * 2 * 200);
        let again = constant_returns(&model, 2, extent, Seed::new(3), &Silent).expect("walked");
        assert_eq!(found, again);
    }
}
