//! Choices by ranks over ensemble members.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::error::check;
use crate::{Direction, StatsError, competition_ranks, mean};

/// The setting that a rule over ranks chose, with the ranks. All vectors except `tie_set` have one entry for each
/// setting, in grid order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Selection {
    /// Index of the chosen setting in the grid.
    pub chosen: usize,
    /// All settings with the smallest rank by the rule, in grid order; `chosen` is one of them.
    pub tie_set: Vec<usize>,
    /// W(λ): largest competition rank over ensemble members.
    pub worst_ranks: Vec<usize>,
    /// Mean competition rank over ensemble members.
    pub mean_ranks: Vec<f64>,
    /// Mean score over ensemble members; infinite if the setting diverged in any of them (`null` in files for
    /// +∞).
    #[serde(with = "crate::diverged::each")]
    #[schemars(with = "Vec<crate::diverged::Stored>")]
    pub mean_errors: Vec<f64>,
    /// Competition ranks, `[members, settings]`.
    pub ranks: Vec<Vec<usize>>,
}

/// The rank over the ensemble members by which a setting is chosen.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RankRule {
    /// The smallest mean rank: one ensemble member that shows no difference between settings does not decide.
    #[default]
    MeanRank,
    /// The smallest worst rank (the paper's rule).
    WorstRank,
}

/// Chooses by `rule` from `scores` `[members, values]`, as [`select`] does by worst rank.
///
/// Ties in the mean rank go to the value with the larger lead over its member's mean, in standard deviations of
/// the member's scores, summed over members; then to the better mean score, then to the earlier one. A value that diverged in a member is
/// infinitely worse.
///
/// # Errors
///
/// As [`select`].
pub fn select_by<Row: AsRef<[f64]>>(
    rule: RankRule,
    scores: &[Row],
    direction: Direction,
) -> Result<Selection, StatsError> {
    let mut selection = select(scores, direction)?;
    if rule == RankRule::WorstRank {
        return Ok(selection);
    }
    let smallest = selection.mean_ranks.iter().copied().fold(f64::INFINITY, f64::min);
    let values = 0..selection.mean_ranks.len();
    // Means of equal ranks, summed in another order, may differ in the last bit.
    selection.tie_set =
        values.filter(|&value| selection.mean_ranks[value] < smallest + 1e-9).collect();
    let leads = leads(scores, direction);
    let largest =
        selection.tie_set.iter().map(|&value| leads[value]).fold(f64::NEG_INFINITY, f64::max);
    // Of two values one always leads by as much as the other lags, so that leads differ in the last bit only.
    let first = selection.tie_set.iter().copied().filter(|&value| leads[value] >= largest - 1e-9);
    selection.chosen = first
        .min_by(|&a, &b| {
            let [one, other] = [a, b].map(|value| selection.mean_errors[value]);
            direction.compare(one, other).then(a.cmp(&b))
        })
        .unwrap_or(0);
    Ok(selection)
}

/// Returns the lead of each value over the mean of its member, in standard deviations, summed over members.
fn leads<Row: AsRef<[f64]>>(scores: &[Row], direction: Direction) -> Vec<f64> {
    let mut leads = vec![0.0; scores[0].as_ref().len()];
    for scores in scores.iter().map(AsRef::as_ref) {
        let finite: Vec<f64> = scores.iter().copied().filter(|score| score.is_finite()).collect();
        let count = finite.len().max(1) as f64;
        let mean = finite.iter().sum::<f64>() / count;
        let variance = finite.iter().map(|score| (score - mean).powi(2)).sum::<f64>() / count;
        for (lead, &score) in leads.iter_mut().zip(scores) {
            *lead += match score {
                _ if !score.is_finite() => f64::NEG_INFINITY,
                _ if variance == 0.0 => 0.0,
                _ if direction == Direction::LowerIsBetter => (mean - score) / variance.sqrt(),
                _ => (score - mean) / variance.sqrt(),
            };
        }
    }
    leads
}

/// Chooses the value with the smallest worst rank from `mean_errors` `[members, values]`: the mean score over
/// runs of each value in each member.
///
/// W(λ) = max over members m of `rank_m(λ)`, 1 = best; the choice is argmin W (the paper's rule). Ties in W go to
/// the lower mean rank, then to the better mean score, then to the earlier value (our choice).
///
/// # Errors
///
/// There are no members or no values, rows differ in length, or a score is NaN.
pub fn select<Row: AsRef<[f64]>>(
    mean_errors: &[Row],
    direction: Direction,
) -> Result<Selection, StatsError> {
    const WHAT: &str = "mean errors of a member";
    let Some(first) = mean_errors.first() else {
        return Err(StatsError::Empty { what: "the ensemble" });
    };
    let values = first.as_ref().len();
    let mut ranks = Vec::with_capacity(mean_errors.len());
    for (row, scores) in mean_errors.iter().map(AsRef::as_ref).enumerate() {
        check(WHAT, scores)?;
        if scores.len() != values {
            let got = scores.len();
            return Err(StatsError::Ragged { what: WHAT, row, expected: values, got });
        }
        ranks.push(competition_ranks(scores, direction)?);
    }

    let column = |value: usize| ranks.iter().map(move |row| row[value]);
    let worst_ranks: Vec<usize> = (0..values).map(|v| column(v).max().unwrap_or(values)).collect();
    let mean_ranks: Vec<f64> =
        (0..values).map(|v| column(v).sum::<usize>() as f64 / ranks.len() as f64).collect();
    let mean_errors = (0..values)
        .map(|v| mean(&mean_errors.iter().map(|row| row.as_ref()[v]).collect::<Vec<_>>()))
        .collect::<Result<Vec<f64>, _>>()?;

    let smallest = worst_ranks.iter().copied().min().unwrap_or(values);
    let tie_set: Vec<usize> = (0..values).filter(|&v| worst_ranks[v] == smallest).collect();
    let best = tie_set.iter().copied().min_by(|&a, &b| {
        mean_ranks[a]
            .total_cmp(&mean_ranks[b])
            .then_with(|| direction.compare(mean_errors[a], mean_errors[b]))
            .then_with(|| a.cmp(&b))
    });
    let chosen = best.unwrap_or(0);
    Ok(Selection { chosen, tie_set, worst_ranks, mean_ranks, mean_errors, ranks })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const INF: f64 = f64::INFINITY;
    const LOWER: Direction = Direction::LowerIsBetter;

    #[test]
    fn ties_of_two_values_go_to_the_better_mean_and_then_to_the_earlier_one() {
        let by_mean = |scores: &[[f64; 2]]| select_by(RankRule::MeanRank, scores, LOWER).unwrap();
        // Each is first in two of four members. The second one loses by more than it wins.
        let members = [[0.7, 0.3], [0.1, 0.9], [0.35, 0.3], [0.11, 0.97]];
        let selection = by_mean(&members);
        assert_eq!((selection.chosen, selection.tie_set), (0, vec![0, 1]));
        let turned = members.map(|[one, other]| [other, one]);
        assert_eq!(by_mean(&turned).chosen, 1);
        assert_eq!(by_mean(&[[1.0, 2.0], [2.0, 1.0]]).chosen, 0);
        assert_eq!(by_mean(&[[INF, 2.0], [2.0, INF]]).chosen, 0, "both diverged in a member");
    }

    #[test]
    fn the_value_that_is_never_bad_wins() {
        // Value 0 is best twice but worst once; value 1 is always second.
        let members = [[0.1, 0.2, 0.3], [0.1, 0.2, 0.3], [0.3, 0.2, 0.1]];
        let selection = select(&members, LOWER).unwrap();
        assert_eq!(selection.worst_ranks, [3, 2, 3]);
        assert_eq!((selection.chosen, selection.tie_set), (1, vec![1]));
    }

    #[test]
    fn ties_go_to_mean_rank_then_mean_error_then_grid_order() {
        // W is 2 for both values; value 1 is first in two of three members.
        let by_rank = select(&[[0.1, 0.9], [0.3, 0.2], [0.3, 0.2]], LOWER).unwrap();
        assert_eq!((by_rank.chosen, by_rank.tie_set), (1, vec![0, 1]));
        let by_error = select(&[[0.1, 0.4], [0.9, 0.3]], LOWER).unwrap();
        assert_eq!((by_error.chosen, by_error.mean_ranks), (1, vec![1.5, 1.5]));
        let by_order = select(&[[0.1, 0.2], [0.2, 0.1]], LOWER).unwrap();
        assert_eq!(by_order.chosen, 0);
    }

    #[test]
    fn higher_returns_win_where_higher_is_better() {
        let selection = select(&[[1.0, 3.0, -INF]], Direction::HigherIsBetter).unwrap();
        assert_eq!((selection.chosen, selection.worst_ranks), (1, vec![2, 1, 3]));
    }

    #[test]
    fn one_blind_member_has_no_last_word_by_mean_rank() {
        // The last member ranks value 1, which is best in the others, last by a tiny margin.
        let members = [[1.0, 2.0, 0.0], [1.0, 2.0, 0.0], [0.501, 0.5, 0.502]];
        let by_worst = select_by(RankRule::WorstRank, &members, Direction::HigherIsBetter).unwrap();
        assert_eq!(by_worst, select(&members, Direction::HigherIsBetter).unwrap());
        assert_eq!((by_worst.chosen, by_worst.worst_ranks), (0, vec![2, 3, 3]));
        let by_mean = select_by(RankRule::MeanRank, &members, Direction::HigherIsBetter).unwrap();
        assert_eq!((by_mean.chosen, by_mean.tie_set), (1, vec![1]));
    }

    #[test]
    fn ties_in_mean_rank_go_to_the_larger_lead() {
        let members = [[1.0, 2.0, 0.0], [1.0, 0.9, -9.0]];
        let tied = select_by(RankRule::MeanRank, &members, Direction::HigherIsBetter).unwrap();
        assert_eq!((tied.tie_set.as_slice(), tied.chosen), (&[0, 1][..], 1));
        // Scores may be errors: value 1 is best in one member and diverged in the other.
        let members = [[-1.0, -2.0, 9.0], [1.0, INF, 2.0]];
        let tied = select_by(RankRule::MeanRank, &members, LOWER).unwrap();
        assert_eq!(tied.chosen, 0);
        let alike = select_by(RankRule::MeanRank, &[[1.0; 3], [1.0; 3]], LOWER).unwrap();
        assert_eq!((alike.chosen, alike.tie_set), (0, vec![0, 1, 2]));
    }

    #[test]
    fn bad_tables_are_errors() {
        assert_eq!(
            select(&[] as &[Vec<f64>], LOWER),
            Err(StatsError::Empty { what: "the ensemble" })
        );
        assert!(matches!(
            select(&[vec![1.0, 2.0], vec![1.0]], LOWER),
            Err(StatsError::Ragged { row: 1, expected: 2, got: 1, .. })
        ));
        assert!(matches!(
            select(&[[0.1, f64::NAN]], LOWER),
            Err(StatsError::NotANumber { index: 1, .. })
        ));
    }

    proptest! {
        #[test]
        fn selection_agrees_with_its_definition(
            table in (1usize..5, 1usize..7).prop_flat_map(|(members, values)| {
                let score = prop_oneof![9 => (0i32..5).prop_map(f64::from), 1 => Just(INF)];
                prop::collection::vec(prop::collection::vec(score, values), members)
            })
        ) {
            let selection = select(&table, LOWER).unwrap();
            let values = table[0].len();
            for v in 0..values {
                let worst = table.iter().map(|row| 1 + row.iter().filter(|x| **x < row[v]).count()).max();
                prop_assert_eq!(Some(selection.worst_ranks[v]), worst);
            }
            let key = |v: usize| (selection.worst_ranks[v], selection.mean_ranks[v], selection.mean_errors[v], v);
            for v in 0..values {
                prop_assert!(key(selection.chosen) <= key(v));
                let tied = selection.worst_ranks[v] == selection.worst_ranks[selection.chosen];
                prop_assert_eq!(selection.tie_set.contains(&v), tied);
            }
        }
    }
}
