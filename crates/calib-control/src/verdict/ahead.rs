//! Decides whether the choice is ahead of the default.

use calib_stats::{Difference, StatsError};

use super::difference::beyond;

/// The fewest blocks of the log for which ranks count. With fewer, every interval is weak: ranks are small integers, so few blocks often
/// have the same difference, and its interval then has no width. Our choice.
pub const FEWEST_BLOCKS: usize = 4;

/// Returns whether the choice is surely ahead of the default, by its extra return in `returns` or by its lead in `ranks`, over this many
/// blocks.
pub(super) fn is_ahead(returns: Difference, ranks: Option<Difference>, blocks: usize) -> bool {
    // Ranks distinguish better if there are many settings, and returns if there are few.
    is_more(returns) || (blocks >= FEWEST_BLOCKS && ranks.is_some_and(is_more))
}

/// Returns by how many ranks the first of two settings is ahead of the second, over kinds of models, with an interval over blocks.
/// `ranks` is `[kinds × blocks][candidates]`.
pub(super) fn ranks_ahead(
    ranks: &[Vec<usize>],
    [first, second]: [usize; 2],
    blocks: usize,
) -> Result<Option<Difference>, StatsError> {
    beyond(&ranks_of(ranks, second, blocks), &ranks_of(ranks, first, blocks))
}

/// Returns the ranks of a setting, `[kinds][blocks]`.
fn ranks_of(ranks: &[Vec<usize>], candidate: usize, blocks: usize) -> Vec<Vec<f64>> {
    ranks
        .chunks(blocks)
        .map(|kind| kind.iter().map(|ranks| ranks[candidate] as f64).collect())
        .collect()
}

/// Returns whether a difference is surely above 0: by its interval, or because the other setting diverged.
fn is_more(difference: Difference) -> bool {
    difference.mean == f64::INFINITY
        || difference.interval.is_some_and(|interval| interval.low > 0.0)
}
