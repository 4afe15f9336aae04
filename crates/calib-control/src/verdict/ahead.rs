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

/// Returns by how many ranks the first of two settings is ahead of the second, over kinds of models, with the jackknife's interval over
/// blocks. `ranks` is `[kinds × blocks][candidates]`.
pub(super) fn ranks_ahead(
    ranks: &[Vec<usize>],
    [first, second]: [usize; 2],
    blocks: usize,
) -> Result<Option<Difference>, StatsError> {
    beyond(&mean_ranks(ranks, second, blocks), &mean_ranks(ranks, first, blocks))
}

/// Returns the mean rank of a setting over kinds of models, `[blocks]`.
fn mean_ranks(ranks: &[Vec<usize>], candidate: usize, blocks: usize) -> Vec<f64> {
    let kinds = (ranks.len() / blocks) as f64;
    (0..blocks)
        .map(|block| ranks.iter().skip(block).step_by(blocks))
        .map(|of_kinds| of_kinds.map(|ranks| ranks[candidate] as f64).sum::<f64>() / kinds)
        .collect()
}

/// Returns whether a difference is surely above 0: by its interval, or because the other setting diverged.
fn is_more(difference: Difference) -> bool {
    difference.mean == f64::INFINITY
        || difference.interval.is_some_and(|interval| interval.low > 0.0)
}
