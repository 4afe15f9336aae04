use calib_stats::{Selection, StatsError};
use serde::{Deserialize, Serialize};

use super::{draw::Drawn, dropped::select_among, errors::Errors};
use crate::Dropped;

/// How a value is chosen from the evidence: the members' runs, and those on the replayed log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rule {
    /// The smallest worst rank over members (the paper). Cautious: one member in which a value is bad is enough to lose.
    WorstRank,
    /// The smallest mean rank over members.
    MeanRank,
    /// The smallest mean error over members.
    MeanError,
    /// The smallest mean logarithm of the error over all runs of all members.
    MeanLogError,
    /// The same over the runs on the replayed log as well: every stream of the log counts the same.
    Pooled,
    /// The default, unless the pooled choice is better by more than one standard error of the paired difference of logarithms. The
    /// standard error is sd / √(n / 3) over the n streams: streams of one log are not independent, and a third of them was
    /// measured to be as many as count.
    OneStandardError,
}

impl Rule {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::WorstRank,
        Self::MeanRank,
        Self::MeanError,
        Self::MeanLogError,
        Self::Pooled,
        Self::OneStandardError,
    ];

    /// Its name in studies and files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::WorstRank => "worst_rank",
            Self::MeanRank => "mean_rank",
            Self::MeanError => "mean_error",
            Self::MeanLogError => "mean_log_error",
            Self::Pooled => "pooled",
            Self::OneStandardError => "one_standard_error",
        }
    }
}

/// Streams in how many of which one is independent of the others, as far as standard errors go.
const STREAMS_PER_INDEPENDENT: f64 = 3.0;

/// What a choice is made from.
pub(super) struct Evidence<'a> {
    pub(super) members: &'a [Errors],
    pub(super) log: Option<&'a Errors>,
    pub(super) dropped: &'a [Dropped],
    pub(super) default: Option<usize>,
    pub(super) values: usize,
}

impl Evidence<'_> {
    /// The worst-rank selection over drawn members and runs.
    pub(super) fn selection(&self, drawn: &Drawn) -> Result<Selection, StatsError> {
        let errors = |(member, runs): &(usize, Vec<usize>)| -> Vec<f64> {
            let streams = &self.members[*member].streams;
            let mean = |value: usize| {
                let made = runs.iter().filter_map(|&run| streams[run].runs[0][value]);
                let (sum, count) = made.fold((0.0, 0_usize), |(sum, n), x| (sum + x, n + 1));
                if count == 0 { f64::INFINITY } else { sum / count as f64 }
            };
            (0..self.values).map(mean).collect()
        };
        let errors: Vec<Vec<f64>> = drawn.members.iter().map(errors).collect();
        select_among(&errors, self.dropped)
    }

    /// The choice of a rule from drawn members, runs and windows of the log.
    pub(super) fn choose(&self, rule: Rule, drawn: &Drawn) -> Result<usize, StatsError> {
        let by_ranks = |key: fn(&Selection, usize) -> [f64; 3]| -> Result<usize, StatsError> {
            let selection = self.selection(drawn)?;
            Ok(least(self.values, |value| key(&selection, value)))
        };
        match rule {
            Rule::WorstRank => Ok(self.selection(drawn)?.chosen),
            Rule::MeanRank => {
                by_ranks(|of, value| [of.mean_ranks[value], of.mean_errors[value], 0.0])
            }
            Rule::MeanError => {
                by_ranks(|of, value| [of.mean_errors[value], of.mean_ranks[value], 0.0])
            }
            Rule::MeanLogError => Ok(self.least_logarithm(&self.streams(drawn, Sources::Members))),
            Rule::Pooled => Ok(self.least_logarithm(&self.streams(drawn, Sources::All))),
            Rule::OneStandardError => Ok(self.around_default(&self.streams(drawn, Sources::All))),
        }
    }

    /// How values stand by a rule, small is good: for correlations with the truth.
    pub(super) fn scores(&self, rule: Rule, drawn: &Drawn) -> Result<Vec<f64>, StatsError> {
        Ok(match rule {
            Rule::WorstRank => selection_order(&self.selection(drawn)?),
            Rule::MeanRank => self.selection(drawn)?.mean_ranks,
            Rule::MeanError => self.selection(drawn)?.mean_errors,
            Rule::MeanLogError => self.logarithms(&self.streams(drawn, Sources::Members)),
            Rule::Pooled | Rule::OneStandardError => {
                self.logarithms(&self.streams(drawn, Sources::All))
            }
        })
    }

    /// Errors of all values on each drawn stream.
    fn streams(&self, drawn: &Drawn, sources: Sources) -> Vec<&[Option<f64>]> {
        let of_members = drawn.members.iter().flat_map(|(member, runs)| {
            runs.iter().map(|&run| &self.members[*member].streams[run].runs[0][..])
        });
        let log = self.log.filter(|_| matches!(sources, Sources::All));
        let of_log = log
            .into_iter()
            .flat_map(|log| drawn.log.iter().map(|&window| &log.streams[window].runs[0][..]));
        of_members.chain(of_log).collect()
    }

    /// Mean logarithm of the error of each value: +∞ where it diverged or was dropped.
    fn logarithms(&self, streams: &[&[Option<f64>]]) -> Vec<f64> {
        let mean = |value: usize| {
            let each = streams.iter().map(|of| of[value].map_or(f64::INFINITY, f64::ln));
            each.sum::<f64>() / streams.len() as f64
        };
        (0..self.values).map(mean).collect()
    }

    fn least_logarithm(&self, streams: &[&[Option<f64>]]) -> usize {
        let logarithms = self.logarithms(streams);
        least(self.values, |value| [logarithms[value], 0.0, 0.0])
    }

    fn around_default(&self, streams: &[&[Option<f64>]]) -> usize {
        let best = self.least_logarithm(streams);
        let Some(default) = self.default else { return best };
        let difference = |of: &&[Option<f64>]| {
            let [own, other] =
                [best, default].map(|value| of[value].map_or(f64::INFINITY, f64::ln));
            own - other
        };
        let differences: Vec<f64> = streams.iter().map(difference).collect();
        if differences.iter().any(|difference| !difference.is_finite()) {
            // The default diverged somewhere, and the best did not: or all did.
            return if differences.contains(&f64::NEG_INFINITY) { best } else { default };
        }
        let count = differences.len() as f64;
        let mean = differences.iter().sum::<f64>() / count;
        let squares = differences.iter().map(|of| (of - mean).powi(2)).sum::<f64>();
        if differences.len() < 2 {
            return default;
        }
        let error = (squares / (count - 1.0)).sqrt() / (count / STREAMS_PER_INDEPENDENT).sqrt();
        if mean < -error { best } else { default }
    }
}

/// Which streams count.
#[derive(Clone, Copy)]
enum Sources {
    Members,
    All,
}

/// The first value with the smallest key.
fn least(values: usize, key: impl Fn(usize) -> [f64; 3]) -> usize {
    let before = |&a: &usize, &b: &usize| {
        let pairs = key(a).into_iter().zip(key(b));
        let order = pairs.map(|(a, b)| a.total_cmp(&b)).find(|order| order.is_ne());
        order.unwrap_or_else(|| a.cmp(&b))
    };
    (0..values).min_by(before).unwrap_or(0)
}

/// Position of each value when the worst rank decides, then mean rank, then mean error.
fn selection_order(selection: &Selection) -> Vec<f64> {
    let key = |value: usize| {
        let rank = selection.worst_ranks[value];
        (rank, selection.mean_ranks[value], selection.mean_errors[value])
    };
    let count = selection.worst_ranks.len();
    let before = |a: usize, b: usize| key(a).partial_cmp(&key(b)) == Some(std::cmp::Ordering::Less);
    (0..count)
        .map(|value| (0..count).filter(|&other| before(other, value)).count() as f64)
        .collect()
}
