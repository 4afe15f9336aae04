//! Compares policies that learn nothing with the chosen setting.

use calib_stats::{Difference, StatsError, jackknife, median};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    FEWEST_BLOCKS, KindReturns,
    difference::{beyond, mean},
};
use crate::{ActionModelKind, ConstantReturns};

/// The constant action with the highest mean return in the model, over ensemble members and kinds of models, among actions whose steps the
/// log covers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BestConstant {
    /// Index of the action.
    pub action: usize,
    /// Mean return per episode.
    #[serde(with = "calib_stats::diverged")]
    #[schemars(with = "calib_stats::diverged::Stored")]
    pub mean_return: f64,
    /// Share of its steps that the log does not cover, in the models of neighbours if there are any.
    pub uncovered: f64,
    /// Mean return of the chosen setting, including the learning phase, minus the mean return of a constant action, with a jackknife
    /// interval over blocks. For each ensemble member the action is the best one in the other members: among many equal actions,
    /// the best one looks better than it is by chance.
    pub over: Option<Difference>,
    /// Its mean return in each kind of model. Large differences show that the models do not know the effect of the action.
    #[serde(default)]
    pub kinds: Vec<KindMean>,
}

/// Mean return of a policy in one kind of model.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct KindMean {
    /// The kind of model.
    pub kind: ActionModelKind,
    /// Mean return per episode, over ensemble members.
    #[serde(with = "calib_stats::diverged")]
    #[schemars(with = "calib_stats::diverged::Stored")]
    pub mean_return: f64,
}

/// Results of random actions, compared with the chosen setting.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RandomActions {
    /// Mean return per episode of random actions.
    #[serde(with = "calib_stats::diverged")]
    #[schemars(with = "calib_stats::diverged::Stored")]
    pub mean_return: f64,
    /// Mean return of the chosen setting, including the learning phase, minus the mean return of random actions, with a jackknife interval
    /// over ensemble members.
    pub over: Option<Difference>,
    /// The ensemble member without which the interval would lie above 0. It is given only if the interval contains 0 and such a member
    /// exists.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outlying: Option<OutlyingMember>,
}

/// An ensemble member in which the chosen setting gets a different return than in the others of the same kind of model.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct OutlyingMember {
    /// The kind of model.
    pub kind: ActionModelKind,
    /// Index of the ensemble member.
    pub member: usize,
    /// Mean return per episode of the chosen setting in this ensemble member.
    pub chosen_return: f64,
}

/// What always taking one action gets, `[kinds][members]`.
struct ConstantAction {
    action: usize,
    returns: Vec<Vec<f64>>,
}

impl ConstantAction {
    /// Its mean return over all members, or over all but one of each kind.
    fn mean_without(&self, left_out: Option<usize>) -> f64 {
        let mut kept = Vec::new();
        for kind in &self.returns {
            let members = kind.iter().enumerate();
            kept.extend(
                members.filter(|&(member, _)| Some(member) != left_out).map(|(_, own)| own),
            );
        }
        mean(&kept)
    }
}

/// The action that gets most over all members, or over all but one; of equal ones the first.
fn best_without(actions: &[ConstantAction], left_out: Option<usize>) -> Option<&ConstantAction> {
    actions.iter().reduce(|best, other| {
        if other.mean_without(left_out) > best.mean_without(left_out) { other } else { best }
    })
}

/// What the action that gets most in the other members gets in each, `[kinds][members]`, so that no action is chosen for what it gets there
/// by chance. One member has no others: there it is the best one.
fn returns_of_best(actions: &[ConstantAction], best: &ConstantAction) -> Vec<Vec<f64>> {
    let mut returns = best.returns.clone();
    let members = returns.first().map_or(0, Vec::len);
    for member in 0..members {
        let left_out = (members > 1).then_some(member);
        let action = best_without(actions, left_out).unwrap_or(best);
        for (kind, of_action) in returns.iter_mut().zip(&action.returns) {
            kind[member] = of_action[member];
        }
    }
    returns
}

/// Returns the returns of the chosen setting in the kinds in which actions were tried, in the same order, `[kinds][members]`.
fn beside(constants: &[&ConstantReturns], each: &[KindReturns], chosen: usize) -> Vec<Vec<f64>> {
    let own = constants.iter().filter_map(|tried| each.iter().find(|own| own.kind == tried.kind));
    own.map(|own| own.of_setting(chosen)).collect()
}

/// The best constant action over the members of these kinds, which lack the same block each, and what the chosen setting gets more than such
/// an action. `each` has the returns of all settings in the ensemble members of each kind. None if more than the share `most_uncovered` of
/// the steps of every action is not covered: the models do not know what such an action leads to.
pub(super) fn best_constant(
    constants: &[&ConstantReturns],
    each: &[KindReturns],
    chosen: usize,
    most_uncovered: f64,
) -> Result<Option<BestConstant>, StatsError> {
    // Neighbours, where there are any, alone know what a step rests on.
    let Some(first) = constants.iter().min_by_key(|of_kind| of_kind.kind) else { return Ok(None) };
    let mut actions = Vec::new();
    for action in 0..first.coverage.len() {
        if first.coverage[action].uncovered() <= most_uncovered {
            let mut returns = Vec::new();
            for of_kind in constants {
                let members = of_kind.members.iter().map(|member| member[action]);
                returns.push(members.collect::<Vec<f64>>());
            }
            actions.push(ConstantAction { action, returns });
        }
    }
    let Some(best) = best_without(&actions, None) else { return Ok(None) };
    let action = best.action;
    let kinds = constants.iter().zip(&best.returns);
    let kinds = kinds.map(|(of_kind, own)| KindMean { kind: of_kind.kind, mean_return: mean(own) });
    Ok(Some(BestConstant {
        action,
        mean_return: best.mean_without(None),
        uncovered: first.coverage[action].uncovered(),
        over: beyond(&beside(constants, each, chosen), &returns_of_best(&actions, best))?,
        kinds: kinds.collect(),
    }))
}

/// Returns the same comparison with random actions.
pub(super) fn random_actions(
    constants: &[&ConstantReturns],
    each: &[KindReturns],
    chosen: usize,
) -> Result<Option<RandomActions>, StatsError> {
    if constants.is_empty() {
        return Ok(None);
    }
    let returns: Vec<Vec<f64>> = constants.iter().map(|of_kind| of_kind.random.clone()).collect();
    let over = beyond(&beside(constants, each, chosen), &returns)?;
    let may_be_chance = over.is_some_and(|over| {
        over.mean > 0.0 && over.interval.is_some_and(|interval| interval.low <= 0.0)
    });
    let outlying = if may_be_chance { outlying_member(constants, each, chosen) } else { None };
    let of_kinds: Vec<f64> = returns.iter().map(|kind| mean(kind)).collect();
    Ok(Some(RandomActions { mean_return: mean(&of_kinds), over, outlying }))
}

/// The factor by which an outlying member is farther from the median of its kind than every other member. Our choice.
const TIMES_AS_FAR: f64 = 3.0;

/// The return of the chosen setting in an ensemble member, and how much more that is than random actions get there.
struct ChosenInMember {
    member: OutlyingMember,
    over_random: f64,
    /// Distance of its return from the median of its kind.
    distance: f64,
}

/// Returns the ensemble member in which the chosen setting's return is farthest from the median of its kind. It must be outlying, and
/// without it the interval over blocks would lie above 0.
fn outlying_member(
    constants: &[&ConstantReturns],
    each: &[KindReturns],
    chosen: usize,
) -> Option<OutlyingMember> {
    let mut all: Vec<ChosenInMember> = Vec::new();
    for returns in each {
        let kind = returns.kind;
        let of_kind = constants.iter().find(|constant| constant.kind == kind)?;
        let own = returns.of_setting(chosen);
        // With few ensemble members no outlying one can be detected.
        if own.len() < FEWEST_BLOCKS {
            return None;
        }
        let middle = median(&own).ok()?;
        let beside_random = own.iter().zip(&of_kind.random).enumerate();
        all.extend(beside_random.map(|(member, (&chosen_return, random))| ChosenInMember {
            member: OutlyingMember { kind, member, chosen_return },
            over_random: chosen_return - random,
            distance: (chosen_return - middle).abs(),
        }));
    }
    all.sort_by(|a, b| a.distance.total_cmp(&b.distance));
    let ChosenInMember { member, distance, .. } = all.pop()?;
    let mut alike = all.iter().filter(|other| other.member.kind == member.kind);
    if alike.any(|other| distance <= TIMES_AS_FAR * other.distance) {
        return None;
    }
    let left = over_random_of_blocks(&all, each);
    let interval = jackknife(mean(&left), &left)?;
    (interval.low > 0.0).then_some(member)
}

/// Returns how much more the chosen setting gets than random actions, for each block with an ensemble member. The returns of policies
/// differ between kinds, so a block counts by the distance of its members from the means of their kinds. A kind that the block lacks then
/// has no effect.
fn over_random_of_blocks(all: &[ChosenInMember], each: &[KindReturns]) -> Vec<f64> {
    let of_kinds: Vec<f64> = each
        .iter()
        .map(|own| {
            let of_kind = all.iter().filter(|other| other.member.kind == own.kind);
            mean(&of_kind.map(|other| other.over_random).collect::<Vec<_>>())
        })
        .collect();
    let whole = mean(&of_kinds);
    let mut blocks = Vec::new();
    for block in 0..each.iter().map(|own| own.members.len()).max().unwrap_or(0) {
        let mut beyond_kinds = Vec::new();
        for (own, of_kind) in each.iter().zip(&of_kinds) {
            let here = all
                .iter()
                .filter(|other| other.member.kind == own.kind && other.member.member == block);
            beyond_kinds.extend(here.map(|other| other.over_random - of_kind));
        }
        if !beyond_kinds.is_empty() {
            blocks.push(whole + mean(&beyond_kinds));
        }
    }
    blocks
}
