//! What a sweep of agents that act says.

use calib_core::Seed;
use calib_stats::{
    Difference, Direction, Drawn, Nested, Selection, StatsError, Summary, hierarchical,
    paired_difference, select, summarise,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{ControlError, Coverage, Decisions, Run};

const HIGHER: Direction = Direction::HigherIsBetter;

/// When a choice is refused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Support {
    /// Most share of the chosen candidate's steps that the log may leave uncovered.
    pub most_uncovered: f64,
    /// Fewest terminals of the log; 0 of a task that has none.
    pub fewest_terminals: usize,
}

impl Default for Support {
    /// Half of the steps, and ten terminals. Our choice: over the logs of docs/control.md, limits from a third to six tenths keep choices that are as good.
    fn default() -> Self {
        Self { most_uncovered: 0.5, fewest_terminals: 10 }
    }
}

/// Why the log does not support a choice.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", tag = "reason")]
pub enum Doubt {
    /// An action was never taken.
    ActionNeverTaken {
        /// Its number.
        action: usize,
    },
    /// Too much of what the chosen candidate did was not recorded.
    Uncovered {
        /// Share of its steps.
        share: f64,
    },
    /// The log has so few terminals that what they depend on is hardly known.
    FewTerminals {
        /// How many it has.
        terminals: usize,
    },
    /// The members rank all candidates alike.
    NotToldApart,
    /// The chosen candidate diverged in a member.
    Diverged,
}

/// What a sweep of agents that act says.
///
/// Returns of a model say which candidate is better, not what it will get: they are for comparison only.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ReturnVerdict {
    /// The chosen candidate, by worst rank over members.
    pub chosen: usize,
    /// The candidate that would be deployed without a choice, if the grid has it.
    pub default: Option<usize>,
    /// Ranks over the members, 1 for the highest mean return.
    pub selection: Selection,
    /// Mean return of each candidate over the runs of each member, `[members][candidates]` (`"-inf"` in files where it diverged).
    #[serde(with = "calib_stats::diverged::rows")]
    #[schemars(with = "Vec<Vec<calib_stats::diverged::Stored>>")]
    pub members: Vec<Vec<f64>>,
    /// Mean return of the chosen one minus that of the default, in the model, over members.
    pub over_default: Option<Difference>,
    /// Mean return of the chosen one minus the mean of all candidates, in the model, over members.
    pub over_random: Difference,
    /// How often each candidate is chosen when members and runs are drawn anew.
    pub chosen_of_resamples: Vec<usize>,
    /// Mean return of the recorded episodes: what the behaviour got. None without a whole episode.
    pub behaviour: Option<Summary>,
    /// What the steps of each candidate rested on, over members and runs.
    pub coverage: Vec<Coverage>,
    /// Why the log does not support the choice; empty if it does.
    pub doubts: Vec<Doubt>,
}

impl ReturnVerdict {
    /// Whether the log supports the choice.
    pub fn is_supported(&self) -> bool {
        self.doubts.is_empty()
    }
}

/// Judge the runs of `candidates` candidates in the model of `log`, in episodes of at most `timeout` steps.
///
/// The choice is the one whose worst rank over the members is best, as for prediction, with the highest mean return as rank 1
/// ([`select`]). Where a candidate diverged its return is −∞.
///
/// # Errors
/// If there are no runs, or not one of every candidate in every run of a member.
pub fn judge(
    runs: &[Run],
    candidates: usize,
    default: Option<usize>,
    (log, timeout): (&Decisions, usize),
    support: Support,
    resamples: usize,
    seed: Seed,
) -> Result<ReturnVerdict, ControlError> {
    let nested = Nested::new(by_member(runs, candidates))?;
    let members = nested.whole().means();
    let selection = select(&members, HIGHER)?;
    let chosen = selection.chosen;
    let of = |candidate: usize| -> Vec<f64> { members.iter().map(|of| of[candidate]).collect() };
    let all: Vec<f64> =
        members.iter().map(|of| of.iter().sum::<f64>() / candidates as f64).collect();
    let clusters: Vec<usize> = (0..members.len()).collect();
    let beside = |other: &[f64]| paired_difference(&clusters, &of(chosen), other);
    let choose = |drawn: &[Drawn<'_>]| Ok(Some(select(&drawn[0].means(), HIGHER)?.chosen));
    let mut rng = seed.child("resamples").rng();
    let shares = hierarchical(&[&nested], resamples, |n| rng.below(n), choose)?;
    let mut coverage = vec![Coverage::default(); candidates];
    for run in runs {
        coverage[run.candidate] = coverage[run.candidate].and(run.coverage);
    }
    let doubts = doubts(&selection, &coverage[chosen], log, support);
    Ok(ReturnVerdict {
        chosen,
        default,
        over_default: default.map(|default| told(beside(&of(default)))).transpose()?.flatten(),
        over_random: told(beside(&all))?.unwrap_or(Difference {
            mean: f64::INFINITY,
            interval: None,
            clusters: [members.len(); 2],
            smaller: None,
        }),
        chosen_of_resamples: shares.counts,
        behaviour: summarise(&log.returns(timeout)).ok(),
        coverage,
        doubts,
        selection,
        members,
    })
}

/// None where both diverged, so that there is no difference.
fn told(of: Result<Difference, StatsError>) -> Result<Option<Difference>, StatsError> {
    match of {
        Ok(difference) => Ok(Some(difference)),
        Err(StatsError::OpposedInfinities { .. }) => Ok(None),
        Err(error) => Err(error),
    }
}

/// Mean returns `[member][run][candidate]`.
fn by_member(runs: &[Run], candidates: usize) -> Vec<Vec<Vec<f64>>> {
    let mut members: Vec<Vec<Vec<f64>>> = Vec::new();
    for run in runs {
        if members.len() <= run.member {
            members.resize(run.member + 1, Vec::new());
        }
        let of_member = &mut members[run.member];
        if of_member.len() <= run.run {
            of_member.resize(run.run + 1, vec![f64::NAN; candidates]);
        }
        of_member[run.run][run.candidate] = run.mean_return;
    }
    members
}

fn doubts(
    selection: &Selection,
    coverage: &Coverage,
    log: &Decisions,
    support: Support,
) -> Vec<Doubt> {
    let mut doubts = Vec::new();
    // Near settings stand for a level that was never set: there coverage tells.
    let has_levels = log.settings().is_none();
    let never = log.counts().into_iter().enumerate().filter(|of| of.1 == 0 && has_levels);
    doubts.extend(never.map(|(action, _)| Doubt::ActionNeverTaken { action }));
    let share = coverage.uncovered();
    if share > support.most_uncovered {
        doubts.push(Doubt::Uncovered { share });
    }
    let terminals = log.terminals();
    if terminals < support.fewest_terminals {
        doubts.push(Doubt::FewTerminals { terminals });
    }
    let alike = selection.tie_set.len() == selection.worst_ranks.len();
    let several = selection.worst_ranks.len() > 1;
    if several && alike && selection.mean_ranks.windows(2).all(|pair| pair[0] == pair[1]) {
        doubts.push(Doubt::NotToldApart);
    }
    if !selection.mean_errors[selection.chosen].is_finite() {
        doubts.push(Doubt::Diverged);
    }
    doubts
}

/// What a choice costs, where the truth is known.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Regret {
    /// True mean return of the best candidate minus that of the chosen one.
    pub regret: f64,
    /// Share of the other candidates whose true return is lower, ties by half.
    pub percentile: f64,
}

/// The regret of `chosen` by the true mean returns of all candidates.
///
/// # Panics
/// If there is no such candidate.
pub fn regret(truth: &[f64], chosen: usize) -> Regret {
    let best = truth.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let own = truth[chosen];
    let below = truth.iter().filter(|&&of| of < own).count() as f64;
    let alike = truth.iter().filter(|&&of| of == own).count() as f64 - 1.0;
    let others = (truth.len() as f64 - 1.0).max(1.0);
    // Where all are −∞, nothing is lost.
    let regret = if own == best { 0.0 } else { best - own };
    Regret { regret, percentile: (below + alike / 2.0) / others }
}

#[cfg(test)]
mod tests;
