//! Ranks, with the two usual rules for ties.

use std::cmp::Ordering;

use crate::error::check;
use crate::{Direction, StatsError};

/// Returns the competition ranks of `scores` `[values]`: 1 is best, ties share the best rank ("1, 2, 2, 4").
///
/// rank(i) = 1 + number of values that are strictly better than value i. Diverged values, which are infinite, rank
/// after every finite one and share that rank. Source: the paper ranks values in each member; the rule for ties is our
/// choice.
///
/// # Errors
///
/// `scores` is empty or holds NaN.
pub fn competition_ranks(scores: &[f64], direction: Direction) -> Result<Vec<usize>, StatsError> {
    check("scores", scores)?;
    let mut ranks = vec![0; scores.len()];
    for ties in tied_groups(scores, |a, b| direction.compare(a, b)) {
        for &value in &ties.members {
            ranks[value] = ties.before + 1;
        }
    }
    Ok(ranks)
}

/// Returns the average ranks of `values` `[n]` in ascending order: ties share the mean of their places ("1, 2.5, 2.5,
/// 4").
///
/// Infinities are ordered like numbers and tie with each other.
///
/// # Errors
///
/// `values` is empty or holds NaN.
pub fn average_ranks(values: &[f64]) -> Result<Vec<f64>, StatsError> {
    check("values", values)?;
    let mut ranks = vec![0.0; values.len()];
    for ties in tied_groups(values, |a, b| a.partial_cmp(&b).unwrap_or(Ordering::Equal)) {
        let rank = (2 * ties.before + ties.members.len() + 1) as f64 / 2.0;
        for &value in &ties.members {
            ranks[value] = rank;
        }
    }
    Ok(ranks)
}

/// Equal values, and the number of values before them.
struct TiedGroup {
    before: usize,
    members: Vec<usize>,
}

fn tied_groups(values: &[f64], compare: impl Fn(f64, f64) -> Ordering) -> Vec<TiedGroup> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| compare(values[a], values[b]));
    let mut before = 0;
    order
        .chunk_by(|&a, &b| compare(values[a], values[b]) == Ordering::Equal)
        .map(|members| {
            let group = TiedGroup { before, members: members.to_vec() };
            before += members.len();
            group
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const INF: f64 = f64::INFINITY;

    #[test]
    fn ranks_of_nothing_are_an_error() {
        assert_eq!(
            competition_ranks(&[], Direction::LowerIsBetter),
            Err(StatsError::Empty { what: "scores" })
        );
        assert!(average_ranks(&[f64::NAN]).is_err());
    }

    /// Returns few distinct numbers, so that ties are common, and both infinities.
    fn scores() -> impl Strategy<Value = Vec<f64>> {
        prop::collection::vec(
            prop_oneof![(-4i32..4).prop_map(f64::from), Just(INF), Just(-INF), Just(-0.0)],
            1..20,
        )
    }

    proptest! {
        #[test]
        fn ranks_agree_with_counting(scores in scores()) {
            let low = competition_ranks(&scores, Direction::LowerIsBetter).unwrap();
            let high = competition_ranks(&scores, Direction::HigherIsBetter).unwrap();
            let average = average_ranks(&scores).unwrap();
            for (i, a) in scores.iter().enumerate() {
                let below = scores.iter().filter(|b| *b < a).count();
                let above = scores.iter().filter(|b| *b > a).count();
                let equal = scores.len() - below - above;
                prop_assert_eq!(low[i], below + 1);
                prop_assert_eq!(high[i], above + 1);
                prop_assert_eq!(average[i], (2 * below + equal + 1) as f64 / 2.0);
            }
        }
    }
}
