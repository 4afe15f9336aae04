use calib_stats::{
    Bounded, Drawn, LogChoice, Selection, StatsError, choose_around_default, choose_by_mean_log,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Dropped, dropped::select_among};
use crate::race::standing;

/// How a setting is chosen from the evidence: the runs in the models and on the replayed log.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Rule {
    /// The smallest worst rank over ensemble members (the paper). Cautious: a setting loses if it is bad in one ensemble member.
    WorstRank,
    /// The smallest mean rank over ensemble members.
    MeanRank,
    /// The smallest mean error over ensemble members.
    MeanError,
    /// The smallest mean logarithm of the error over all runs in all ensemble members.
    MeanLogError,
    /// The smallest mean logarithm of the error over the runs in the models and on the replayed log: every run counts the same.
    Pooled,
    /// The smallest mean logarithm of the error over the runs on the replayed log only; over those in the models if nothing was replayed.
    LogReplay,
    /// The best by mean logarithm of the settings that beat the default over the same runs by at least one standard error of the mean paired difference of logarithms. The default if there is no such setting.
    OneStandardError,
}

impl Rule {
    /// All rules.
    pub const ALL: [Self; 7] = [
        Self::WorstRank,
        Self::MeanRank,
        Self::MeanError,
        Self::MeanLogError,
        Self::Pooled,
        Self::LogReplay,
        Self::OneStandardError,
    ];

    /// Whether the rule ranks settings by the mean logarithm of their errors.
    pub const fn is_by_logarithms(self) -> bool {
        match self {
            Self::WorstRank | Self::MeanRank | Self::MeanError => false,
            Self::MeanLogError | Self::Pooled | Self::LogReplay | Self::OneStandardError => true,
        }
    }

    /// Whether the rule is offered without a model, when it chooses by log replay alone. `Pooled` is not: it would then
    /// equal `LogReplay`.
    pub const fn works_without_model(self) -> bool {
        match self {
            Self::LogReplay | Self::OneStandardError => true,
            Self::WorstRank
            | Self::MeanRank
            | Self::MeanError
            | Self::MeanLogError
            | Self::Pooled => false,
        }
    }

    /// Returns the name in studies and files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::WorstRank => "worst_rank",
            Self::MeanRank => "mean_rank",
            Self::MeanError => "mean_error",
            Self::MeanLogError => "mean_log_error",
            Self::Pooled => "pooled",
            Self::LogReplay => "log_replay",
            Self::OneStandardError => "one_standard_error",
        }
    }
}

/// Number of streams per independent stream, for standard errors. Measured on members with three runs each.
const STREAMS_PER_INDEPENDENT: f64 = 3.0;

/// The evidence for a choice: all runs, or a resample of them.
#[derive(Clone, Copy)]
pub(super) struct Evidence<'d, 'a> {
    /// Members with their rollouts. `None` without a model.
    pub(super) members: Option<&'d Drawn<'a>>,
    /// Windows of the replayed log.
    pub(super) log: Option<&'d Drawn<'a>>,
}

/// The parts of a choice that are the same for all resamples.
pub(super) struct Chooser<'a> {
    pub(super) dropped: &'a [Dropped],
    pub(super) default: Option<usize>,
    pub(super) values: usize,
}

impl Chooser<'_> {
    /// Returns the worst-rank selection.
    ///
    /// # Errors
    /// Returns an error if there are no members to rank in.
    pub(super) fn selection(&self, evidence: Evidence<'_, '_>) -> Result<Selection, StatsError> {
        select_among(&evidence.members.map(Drawn::means).unwrap_or_default(), self.dropped)
    }

    pub(super) fn choose(
        &self,
        rule: Rule,
        evidence: Evidence<'_, '_>,
    ) -> Result<usize, StatsError> {
        match rule {
            Rule::WorstRank => Ok(self.selection(evidence)?.chosen),
            Rule::MeanRank => self.first_by(evidence, |selection, value| {
                [selection.mean_ranks[value], selection.mean_errors[value]]
            }),
            Rule::MeanError => self.first_by(evidence, |selection, value| {
                [selection.mean_errors[value], selection.mean_ranks[value]]
            }),
            Rule::MeanLogError | Rule::Pooled | Rule::LogReplay => {
                let streams = evidence.sources(rule);
                let LogChoice { chosen, .. } = choose_by_mean_log(&streams)?;
                Ok(chosen.unwrap_or_else(|| least_divergent(&streams.concat())))
            }
            Rule::OneStandardError => match self.default {
                Some(default) => {
                    let sources = evidence.sources(rule);
                    Ok(choose_around_default(&sources, default, STREAMS_PER_INDEPENDENT)?.chosen)
                }
                None => self.choose(Rule::Pooled, evidence),
            },
        }
    }

    /// Returns the first of the settings with the smallest `key`.
    fn first_by(
        &self,
        evidence: Evidence<'_, '_>,
        key: fn(&Selection, usize) -> [f64; 2],
    ) -> Result<usize, StatsError> {
        let mut selection = self.selection(evidence)?;
        self.without_dropped(&mut selection.mean_errors);
        let keys: Vec<[f64; 2]> = (0..self.values).map(|value| key(&selection, value)).collect();
        Ok(first_smallest(&keys))
    }

    /// Sets the mean errors of dropped settings to infinity. They made few runs, so their means do not compare with the
    /// others.
    pub(super) fn without_dropped(&self, mean_errors: &mut [f64]) {
        for dropped in self.dropped {
            mean_errors[dropped.candidate] = f64::INFINITY;
        }
    }

    /// Returns the score of each setting by a rule. Smaller is better. Used for correlations with the truth.
    pub(super) fn scores(
        &self,
        rule: Rule,
        evidence: Evidence<'_, '_>,
    ) -> Result<Vec<f64>, StatsError> {
        Ok(match rule {
            Rule::WorstRank => selection_order(&self.selection(evidence)?),
            Rule::MeanRank => self.selection(evidence)?.mean_ranks,
            Rule::MeanError => {
                let mut errors = self.selection(evidence)?.mean_errors;
                self.without_dropped(&mut errors);
                errors
            }
            Rule::MeanLogError | Rule::Pooled | Rule::LogReplay | Rule::OneStandardError => {
                choose_by_mean_log(&evidence.sources(rule))?.mean_logs
            }
        })
    }
}

impl<'a> Evidence<'_, 'a> {
    /// Returns the errors on all streams that count for a rule by logarithms: `[source][stream][setting]`.
    fn sources(&self, rule: Rule) -> Vec<Vec<&'a [f64]>> {
        let log = self.log.filter(|_| rule != Rule::MeanLogError);
        let members = self.members.filter(|_| rule != Rule::LogReplay || log.is_none());
        [members, log].into_iter().flatten().map(Drawn::runs).collect()
    }
}

/// Returns the setting that diverged in the fewest streams, if all settings diverged somewhere. Ties go to the smallest
/// mean logarithm of the error in the other streams.
fn least_divergent(streams: &[&[f64]]) -> usize {
    let values = streams.first().map_or(0, |errors| errors.len());
    let keys = (0..values).map(|value| {
        let logs: Vec<f64> = streams.iter().map(|errors| errors[value].ln()).collect();
        let (diverged, mean) = standing(&logs);
        [diverged as f64, mean]
    });
    first_smallest(&keys.collect::<Vec<_>>())
}

/// Whether the choice diverged in the evidence that it was made from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ChoiceStanding {
    /// The choice never diverged.
    Finite,
    /// The choice diverged in some stream, and so did every other setting.
    Diverged,
}

impl ChoiceStanding {
    /// Returns the standing of the choice of a rule that ranks settings by `scores`.
    pub(super) fn of(
        rule: Rule,
        chosen: usize,
        scores: &[f64],
        selection: Option<&Selection>,
    ) -> Self {
        let error = match selection {
            Some(selection) if !rule.is_by_logarithms() => selection.mean_errors[chosen],
            _ => scores[chosen],
        };
        if error == f64::INFINITY { Self::Diverged } else { Self::Finite }
    }
}

fn first_smallest(keys: &[[f64; 2]]) -> usize {
    (0..keys.len())
        .min_by(|&a, &b| {
            let [a, b] = [keys[a], keys[b]];
            a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1]))
        })
        .unwrap_or(0)
}

/// Returns the rank position of each setting: by worst rank, then mean rank, then mean error.
fn selection_order(selection: &Selection) -> Vec<f64> {
    let ranks = selection.worst_ranks.iter().zip(&selection.mean_ranks);
    let keys: Vec<_> = ranks.zip(&selection.mean_errors).collect();
    keys.iter().map(|key| keys.iter().filter(|other| *other < key).count() as f64).collect()
}

/// The choice of a rule, with its regret.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RuleChoice {
    /// The rule.
    pub rule: Rule,
    /// Index of the chosen setting.
    pub chosen: usize,
    /// Regret of the choice; none without held-out data.
    pub regret: Option<Bounded>,
}
