//! Judges a sweep of agents that act.

mod ahead;
mod difference;
mod doubt;
mod evidence;
mod floors;
mod kind_returns;
mod step_rates;
mod support;

use calib_core::Seed;
use calib_stats::{
    Difference, Direction, Drawn, Nested, RankRule, Selection, StatsError, column_means,
    hierarchical, select_by, spearman,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    ActionModelKind, ConstantReturns, ControlError, Coverage, Decisions, Drift, RecordedReturn, Run,
};
pub use ahead::FEWEST_BLOCKS;
use ahead::{is_ahead, ranks_ahead};
use difference::{beyond, mean};
pub use doubt::Doubt;
use evidence::Evidence;
pub use floors::{BestConstant, KindMean, OutlyingMember, RandomActions};
use floors::{best_constant, random_actions};
pub use kind_returns::KindReturns;
pub use step_rates::StepRates;
pub use support::Support;

const HIGHER: Direction = Direction::HigherIsBetter;

/// With fewer settings, kinds often have the same order by chance. Our choice.
const FEWEST_ORDERED: usize = 4;

/// Kinds of models with a lower agreement do not support an order of the settings. Our choice: docs/control.md.
pub const KINDS_AGREE: f64 = 0.5;

/// Result of a sweep of agents that act.
///
/// Returns in a model show which setting is better, not which return it will get at the plant. They are for comparison only.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ReturnVerdict {
    /// The rule that chose the setting.
    pub rule: RankRule,
    /// Index of the chosen setting.
    pub chosen: usize,
    /// Index of the setting that would be deployed without a choice, if the grid has it.
    pub default: Option<usize>,
    /// Ranks over the ensemble members of all kinds of models, one kind after the other; 1 for the highest mean return.
    pub selection: Selection,
    /// Results of each kind of model.
    pub kinds: Vec<KindReturns>,
    /// Mean return of each setting in the ensemble members without each block of the log, over kinds and runs, `[blocks][candidates]`
    /// (`"-inf"` in files where it diverged).
    #[serde(with = "calib_stats::diverged::rows")]
    #[schemars(with = "Vec<Vec<calib_stats::diverged::Stored>>")]
    pub members: Vec<Vec<f64>>,
    /// Mean return of the chosen setting minus the mean return of the default in the model, with a jackknife interval over ensemble
    /// members.
    pub over_default: Option<Difference>,
    /// Mean rank of the default minus the mean rank of the chosen setting, with a jackknife interval over ensemble members. Above 0 the
    /// chosen setting is ahead. With fewer than four ensemble members it decides nothing.
    pub ranks_over_default: Option<Difference>,
    /// Mean return of the chosen setting minus the mean over all settings, with a jackknife interval over ensemble members.
    pub over_random: Difference,
    /// The best policy with a constant action, if constant actions were tried and the log covers the steps of one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub constant: Option<BestConstant>,
    /// Results of random actions, if they were tried.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub random_actions: Option<RandomActions>,
    /// How often each setting is chosen in resamples of ensemble members and runs.
    pub chosen_of_resamples: Vec<usize>,
    /// Return of the recorded behaviour.
    pub behaviour: RecordedReturn,
    /// Coverage of the steps of each setting, over ensemble members and runs of the first kind of model.
    pub coverage: Vec<Coverage>,
    /// Displacement of the chosen setting's episodes by jumps between recorded transitions, over ensemble members and runs.
    pub drift: Drift,
    /// Terminals and rewards of the chosen setting's steps; none in verdicts of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step_rates: Option<StepRates>,
    /// Reasons why the log does not support the choice; empty if it does.
    pub doubts: Vec<Doubt>,
}

/// The options of a judgement about the runs of a sweep.
#[derive(Clone, Copy, Debug)]
pub struct Question<'a> {
    /// The log of the models.
    pub log: &'a Decisions,
    /// Steps after which an episode was cut.
    pub timeout: usize,
    /// Number of settings.
    pub candidates: usize,
    /// The setting that would be deployed without a choice, if the grid has it.
    pub default: Option<usize>,
    /// The rule that chooses a setting.
    pub rule: RankRule,
    /// The limits below which a choice is refused.
    pub support: Support,
    /// Number of bootstrap resamples of ensemble members and runs.
    pub resamples: usize,
    /// Returns of constant actions in the ensemble members of each kind of model; empty if they were not tried.
    pub constants: &'a [ConstantReturns],
}

impl<'a> Question<'a> {
    /// Returns the default options for `candidates` settings, none of which is the default setting: the default
    /// rule and limits, with 200 resamples.
    pub fn new(log: &'a Decisions, timeout: usize, candidates: usize) -> Self {
        Self {
            log,
            timeout,
            candidates,
            default: None,
            rule: RankRule::default(),
            support: Support::default(),
            resamples: 200,
            constants: &[],
        }
    }
}

impl ReturnVerdict {
    /// Returns whether the log supports the choice.
    pub fn is_supported(&self) -> bool {
        self.doubts.is_empty()
    }

    /// Returns whether the chosen setting is ahead of the default in the models, whatever other doubts there are about its deployment.
    /// Models rank better than they promise: docs/control.md has the regret of such choices.
    pub fn is_ahead_of_default(&self) -> bool {
        self.default.is_some_and(|default| default != self.chosen)
            && !self.doubts.iter().any(|doubt| {
                matches!(doubt, Doubt::NotBetterThanDefault | Doubt::NotToldApart | Doubt::Diverged)
            })
    }

    /// Returns the agreement of the kinds of models on the order of the settings: Spearman's correlation of their mean ranks, as a mean
    /// over pairs of kinds. A kind that ranks all settings alike agrees with none. Returns `None` for one kind, or for too few settings.
    /// Choices on which kinds agree have little regret (docs/control.md).
    pub fn kinds_agreement(&self) -> Option<f64> {
        if self.kinds.len() < 2 || self.selection.mean_ranks.len() < FEWEST_ORDERED {
            return None;
        }
        let ranks: Vec<Vec<f64>> = self
            .kinds
            .iter()
            .map(|own| {
                select_by(RankRule::MeanRank, &own.members, HIGHER)
                    .map(|selection| selection.mean_ranks)
            })
            .collect::<Result<_, _>>()
            .ok()?;
        let mut correlations = Vec::new();
        for (place, one) in ranks.iter().enumerate() {
            for other in &ranks[place + 1..] {
                correlations.push(spearman(one, other).ok()?.unwrap_or(0.0));
            }
        }
        Some(correlations.iter().sum::<f64>() / correlations.len() as f64)
    }
}

/// Judges the runs of a sweep.
///
/// Each ensemble member of each kind of model ranks the settings by mean return, the highest first. The rule makes the choice from all
/// these ranks ([`select_by`]). A setting that diverged has a return of −∞.
///
/// # Errors
/// If there are no runs, or a setting is missing in a run of an ensemble member of some kind.
pub fn judge(
    runs: &[Run],
    question: &Question<'_>,
    seed: Seed,
) -> Result<ReturnVerdict, ControlError> {
    let Question { log, timeout, candidates, default, rule, support, constants, .. } = *question;
    let mut kinds: Vec<ActionModelKind> = runs.iter().map(|run| run.kind).collect();
    kinds.sort_unstable();
    kinds.dedup();
    // Members of different kinds that lack the same block are dependent, and so are runs with the same random numbers.
    let nested = Nested::new(by_block(runs, &kinds, candidates))?;
    let blocks = nested.whole().means();
    let selection = select_by(rule, &of_all_kinds(&blocks, candidates), HIGHER)?;
    let chosen = selection.chosen;
    let each = of_each_kind(&blocks, &kinds, rule, candidates)?;
    let members: Vec<Vec<f64>> = blocks.iter().map(|block| over_kinds(block, candidates)).collect();
    let own_returns = of_setting(&each, chosen);
    // Coverage and drift come from the first kind, which is neighbours if there are any: only they know the coverage
    // of a step and its jump.
    let first = runs.iter().filter(|run| run.kind == kinds[0]);
    let coverage = coverage_of(first, candidates);
    let over_default = match default {
        Some(default) => beyond(&own_returns, &of_setting(&each, default))?,
        None => None,
    };
    let over_random = beyond(&own_returns, &of_random_setting(&each))?;
    let ranks_over_default = match default {
        Some(default) => ranks_ahead(&selection.ranks, [chosen, default], members.len())?,
        None => None,
    };
    // A kind whose agents could not be tried is left out.
    let constants: Vec<&ConstantReturns> =
        constants.iter().filter(|constant| kinds.contains(&constant.kind)).collect();
    let constant = best_constant(&constants, &each, chosen, support.most_uncovered)?;
    let random_actions = random_actions(&constants, &each, chosen)?;
    let behaviour = log.recorded_return(timeout)?;
    let own: Vec<&Run> = runs.iter().filter(|run| run.candidate == chosen).collect();
    let drift = drift_of(own.iter().filter(|run| run.kind == kinds[0]));
    let step_rates = StepRates::of(&own, &kinds, log);
    let evidence = Evidence {
        blocks: members.len(),
        selection: &selection,
        coverage: coverage[chosen],
        step_rates,
        drift: &drift,
        is_ahead: over_default
            .filter(|_| default != Some(chosen))
            .map(|over| is_ahead(over, ranks_over_default, members.len())),
        constant: constant.as_ref(),
        random_actions,
        behaviour,
    };
    let doubts = evidence.doubts(log, support);
    Ok(ReturnVerdict {
        rule,
        chosen,
        default,
        kinds: each,
        over_default,
        ranks_over_default,
        constant,
        random_actions,
        over_random: over_random.unwrap_or(Difference {
            mean: f64::INFINITY,
            interval: None,
            clusters: [members.len(); 2],
            smaller: None,
        }),
        chosen_of_resamples: chosen_again(&nested, question, seed)?,
        behaviour,
        coverage,
        drift,
        step_rates: selection.mean_errors[chosen].is_finite().then_some(step_rates),
        doubts,
        selection,
        members,
    })
}

/// Returns the returns of a setting in each kind of model, `[kinds][members]`.
fn of_setting(kinds: &[KindReturns], candidate: usize) -> Vec<Vec<f64>> {
    kinds.iter().map(|kind| kind.of_setting(candidate)).collect()
}

/// Returns the mean returns of all settings in each kind of model, `[kinds][members]`.
fn of_random_setting(kinds: &[KindReturns]) -> Vec<Vec<f64>> {
    kinds.iter().map(|kind| kind.members.iter().map(|returns| mean(returns)).collect()).collect()
}

/// Returns the results of each kind, from `[blocks][kinds × candidates]`.
fn of_each_kind(
    blocks: &[Vec<f64>],
    kinds: &[ActionModelKind],
    rule: RankRule,
    candidates: usize,
) -> Result<Vec<KindReturns>, StatsError> {
    let each = kinds.iter().enumerate().map(|(place, &kind)| {
        let members = of_kind(blocks, place, candidates);
        let chosen = select_by(rule, &members, HIGHER)?.chosen;
        Ok(KindReturns { kind, chosen, members })
    });
    each.collect()
}

/// Returns how often each setting is chosen in bootstrap resamples of ensemble members and runs.
fn chosen_again(
    nested: &Nested,
    question: &Question<'_>,
    seed: Seed,
) -> Result<Vec<usize>, StatsError> {
    let Question { candidates, rule, resamples, .. } = *question;
    let mut rng = seed.child("resamples").rng();
    let mut shares = hierarchical(
        &[nested],
        resamples,
        |n| rng.below(n),
        |drawn: &[Drawn<'_>]| {
            Ok(Some(select_by(rule, &of_all_kinds(&drawn[0].means(), candidates), HIGHER)?.chosen))
        },
    )?;
    shares.counts.truncate(candidates);
    Ok(shares.counts)
}

/// Returns the sum of the displacements of these runs.
fn drift_of<'a>(runs: impl Iterator<Item = &'a &'a Run>) -> Drift {
    runs.fold(Drift::default(), |all, run| all.and(&run.drift))
}

/// Returns the coverage of each setting's steps, over these runs.
fn coverage_of<'a>(runs: impl Iterator<Item = &'a Run>, candidates: usize) -> Vec<Coverage> {
    let mut coverage = vec![Coverage::default(); candidates];
    for run in runs {
        coverage[run.candidate] = coverage[run.candidate].and(run.coverage);
    }
    coverage
}

/// Returns mean returns as `[block][run][kind × candidates + candidate]`.
fn by_block(runs: &[Run], kinds: &[ActionModelKind], candidates: usize) -> Vec<Vec<Vec<f64>>> {
    let mut blocks: Vec<Vec<Vec<f64>>> = Vec::new();
    for run in runs {
        if blocks.len() <= run.member {
            blocks.resize(run.member + 1, Vec::new());
        }
        let of_block = &mut blocks[run.member];
        if of_block.len() <= run.run {
            of_block.resize(run.run + 1, vec![f64::NAN; kinds.len() * candidates]);
        }
        let kind = kinds.binary_search(&run.kind).unwrap_or(0);
        of_block[run.run][kind * candidates + run.candidate] = run.mean_return;
    }
    blocks
}

/// Returns the mean returns of one kind, `[blocks][candidates]`, from `[blocks][kinds × candidates]`.
fn of_kind(blocks: &[Vec<f64>], kind: usize, candidates: usize) -> Vec<Vec<f64>> {
    blocks.iter().map(|block| block[kind * candidates..][..candidates].to_vec()).collect()
}

/// Returns the mean returns of all ensemble members, `[kinds × blocks][candidates]`.
fn of_all_kinds(blocks: &[Vec<f64>], candidates: usize) -> Vec<Vec<f64>> {
    let kinds = blocks.first().map_or(0, |block| block.len() / candidates);
    (0..kinds).flat_map(|kind| of_kind(blocks, kind, candidates)).collect()
}

/// Returns the mean over kinds of each setting's returns in one block.
fn over_kinds(block: &[f64], candidates: usize) -> Vec<f64> {
    column_means(&block.chunks(candidates).collect::<Vec<_>>())
}

/// The cost of a choice, if the true returns are known.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Regret {
    /// True mean return of the best setting minus the true mean return of the chosen one.
    pub regret: f64,
    /// Share of the other settings with a lower true return; ties count half.
    pub percentile: f64,
}

/// Returns the regret of `chosen` by the true mean returns of all settings.
///
/// # Panics
/// If there is no such setting.
pub fn regret(truth: &[f64], chosen: usize) -> Regret {
    let best = truth.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let own = truth[chosen];
    let below = truth.iter().filter(|&&other| other < own).count() as f64;
    let alike = truth.iter().filter(|&&other| other == own).count() as f64 - 1.0;
    let others = (truth.len() as f64 - 1.0).max(1.0);
    // If all returns are −∞, the regret is 0.
    let regret = if own == best { 0.0 } else { best - own };
    Regret { regret, percentile: (below + alike / 2.0) / others }
}

#[cfg(test)]
mod tests;
