//! Policies that learn nothing, beside the chosen candidate.

use calib_stats::{Difference, StatsError};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{beyond, mean};
use crate::ConstantReturns;

/// The action that gets most in the model where it is always taken, over members and kinds of models.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BestConstant {
    /// The action.
    pub action: usize,
    /// Its mean return an episode.
    #[serde(with = "calib_stats::diverged")]
    #[schemars(with = "calib_stats::diverged::Stored")]
    pub mean_return: f64,
    /// Share of its steps that the log does not cover, in the first kind of model.
    pub uncovered: f64,
    /// Mean return of the chosen candidate, learning included, minus that of the action, with the jackknife's interval over members.
    pub over: Option<Difference>,
}

/// A policy whose actions are drawn at random, beside the chosen candidate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RandomActions {
    /// Its mean return an episode.
    #[serde(with = "calib_stats::diverged")]
    #[schemars(with = "calib_stats::diverged::Stored")]
    pub mean_return: f64,
    /// Mean return of the chosen candidate, learning included, minus that, with the jackknife's interval over members.
    pub over: Option<Difference>,
}

/// The best constant action over the members of these kinds, which lack the same block each, and what `own`, the mean returns of the
/// chosen candidate `[members]`, are more than it.
pub(super) fn best_constant(
    constants: &[&ConstantReturns],
    own: &[f64],
) -> Result<Option<BestConstant>, StatsError> {
    let Some(first) = constants.first() else { return Ok(None) };
    let actions = (0..first.coverage.len()).map(|action| {
        (
            action,
            over_all_kinds(constants, own.len(), |of_kind, member| of_kind.members[member][action]),
        )
    });
    // Of equal ones the first.
    let best =
        actions.reduce(|best, other| if mean(&other.1) > mean(&best.1) { other } else { best });
    let Some((action, returns)) = best else { return Ok(None) };
    Ok(Some(BestConstant {
        action,
        mean_return: mean(&returns),
        uncovered: first.coverage[action].uncovered(),
        over: beyond(own, &returns)?,
    }))
}

/// Actions at random, likewise.
pub(super) fn random_actions(
    constants: &[&ConstantReturns],
    own: &[f64],
) -> Result<Option<RandomActions>, StatsError> {
    if constants.is_empty() {
        return Ok(None);
    }
    let returns = over_all_kinds(constants, own.len(), |of_kind, member| of_kind.random[member]);
    Ok(Some(RandomActions { mean_return: mean(&returns), over: beyond(own, &returns)? }))
}

/// What a policy gets in each member, the mean over kinds.
fn over_all_kinds(
    constants: &[&ConstantReturns],
    members: usize,
    of_member: impl Fn(&ConstantReturns, usize) -> f64,
) -> Vec<f64> {
    (0..members)
        .map(|member: usize| {
            let sum: f64 = constants.iter().map(|of_kind| of_member(of_kind, member)).sum();
            sum / constants.len() as f64
        })
        .collect()
}
