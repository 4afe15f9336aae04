//! Settings that a race dropped, as the verdict reports them.

use std::collections::BTreeSet;

use calib_stats::{Direction, Selection, StatsError, select};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{EnvironmentId, UnitResult};

pub(super) const LOWER: Direction = Direction::LowerIsBetter;

/// A setting that was dropped before all runs were made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Dropped {
    /// Index of the setting in the sweep.
    pub candidate: usize,
    /// Number of its runs in ensemble members and on the log, each of all steps.
    pub runs: usize,
    /// Number of such runs of each remaining setting.
    pub of_runs: usize,
    /// Mean error over the ensemble members in which it made runs, or on the log if there is no model; infinite if it
    /// made none.
    #[serde(with = "calib_stats::diverged")]
    #[schemars(with = "Option<f64>")]
    pub mean_error: f64,
}

/// Returns the dropped settings among `grid` settings, best first: those with more runs, then those with the lower
/// error. `mean_errors` is `[member, setting]`, with the members in numeric order. Without a model it has one row for
/// the log.
pub(super) fn dropped(
    results: &[&UnitResult],
    grid: usize,
    mean_errors: &[Vec<f64>],
) -> Vec<Dropped> {
    let mut runs = vec![0; grid];
    for result in results {
        if result.unit.environment != EnvironmentId::Online {
            for row in result.rows.iter().filter(|row| row.candidate < grid) {
                runs[row.candidate] += 1;
            }
        }
    }
    let members: BTreeSet<EnvironmentId> = results
        .iter()
        .map(|result| result.unit.environment)
        .filter(|environment| matches!(environment, EnvironmentId::Member(_)))
        .collect();
    let members: Vec<EnvironmentId> = if members.is_empty() {
        vec![EnvironmentId::LogReplay]
    } else {
        members.into_iter().collect()
    };
    let of_runs = runs.iter().copied().max().unwrap_or(0);
    let mut dropped: Vec<Dropped> = (0..grid)
        .filter(|&candidate| runs[candidate] < of_runs)
        .map(|candidate| Dropped {
            candidate,
            runs: runs[candidate],
            of_runs,
            mean_error: mean_error(candidate, results, &members, mean_errors),
        })
        .collect();
    dropped.sort_by(|a, b| b.runs.cmp(&a.runs).then(a.mean_error.total_cmp(&b.mean_error)));
    dropped
}

/// Returns [`Dropped::mean_error`].
fn mean_error(
    candidate: usize,
    results: &[&UnitResult],
    members: &[EnvironmentId],
    mean_errors: &[Vec<f64>],
) -> f64 {
    // Members without a run of the setting are left out, because their mean error is infinite.
    let own: Vec<f64> = (0..members.len())
        .filter(|&place| {
            results.iter().any(|result| {
                result.unit.environment == members[place]
                    && result.rows.iter().any(|row| row.candidate == candidate)
            })
        })
        .map(|place| mean_errors[place][candidate])
        .collect();
    if own.is_empty() { f64::INFINITY } else { own.iter().sum::<f64>() / own.len() as f64 }
}

/// Applies the worst-rank rule among the settings that made all runs. The dropped settings rank behind them in every
/// member, in their order. The ranks of the others ignore the dropped settings.
pub(super) fn select_among(
    mean_errors: &[Vec<f64>],
    dropped: &[Dropped],
) -> Result<Selection, StatsError> {
    if dropped.is_empty() {
        return select(mean_errors, LOWER);
    }
    let grid = mean_errors.first().map_or(0, Vec::len);
    let kept: Vec<usize> = (0..grid)
        .filter(|&candidate| dropped.iter().all(|dropped| dropped.candidate != candidate))
        .collect();
    let among: Vec<Vec<f64>> = mean_errors
        .iter()
        .map(|member| kept.iter().map(|&candidate| member[candidate]).collect())
        .collect();
    let inner = select(&among, LOWER)?;
    let mut whole = Selection {
        chosen: kept[inner.chosen],
        tie_set: inner.tie_set.iter().map(|&place| kept[place]).collect(),
        worst_ranks: vec![0; grid],
        mean_ranks: vec![0.0; grid],
        mean_errors: vec![0.0; grid],
        ranks: vec![vec![0; grid]; mean_errors.len()],
    };
    for (place, &candidate) in kept.iter().enumerate() {
        whole.worst_ranks[candidate] = inner.worst_ranks[place];
        whole.mean_ranks[candidate] = inner.mean_ranks[place];
        whole.mean_errors[candidate] = inner.mean_errors[place];
        for (ranks, ranks_of_others) in whole.ranks.iter_mut().zip(&inner.ranks) {
            ranks[candidate] = ranks_of_others[place];
        }
    }
    for (place, dropped) in dropped.iter().enumerate() {
        let candidate = dropped.candidate;
        let rank = kept.len() + 1 + place;
        whole.worst_ranks[candidate] = rank;
        whole.mean_ranks[candidate] = rank as f64;
        whole.mean_errors[candidate] = dropped.mean_error;
        for ranks in &mut whole.ranks {
            ranks[candidate] = rank;
        }
    }
    Ok(whole)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_dropped_rank_behind_all_others_in_their_order() {
        let errors = [vec![0.1, 5.0, 0.2, 4.0], vec![0.3, 0.01, 0.2, 4.0]];
        let dropped = [(3, 2, 4.0), (1, 1, 2.5)].map(|(candidate, runs, mean_error)| Dropped {
            candidate,
            runs,
            of_runs: 4,
            mean_error,
        });
        let selection = select_among(&errors, &dropped).expect("selected");
        assert_eq!(selection.ranks, [[1, 4, 2, 3], [2, 4, 1, 3]]);
        assert_eq!(selection.worst_ranks, [2, 4, 2, 3]);
        assert_eq!(selection.tie_set, [0, 2]);
        assert_eq!(selection.chosen, 0, "of equal ranks and errors the first");
        assert_eq!(selection.mean_errors[1], 2.5);
        // If ranks included the second setting, its good member would cost the others a rank there.
        let all = select_among(&errors, &[]).expect("selected");
        assert_eq!(all.ranks[1], [3, 1, 2, 4]);
    }
}
