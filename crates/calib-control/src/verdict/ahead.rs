//! Whether the choice is ahead of the default.

use calib_stats::{Difference, StatsError};

use super::beyond;

/// Over fewer blocks of the log ranks alone show nothing, and every interval is weak. Ranks are small integers, so few blocks often have the
/// same difference, and its interval then has no width. Our choice.
pub const FEWEST_BLOCKS: usize = 4;

/// Whether the choice is surely ahead of the default, by what it gets more in `returns`, or by the `ranks` that it is ahead, over so many
/// blocks.
pub(super) fn is_ahead(returns: Difference, ranks: Option<Difference>, blocks: usize) -> bool {
    // Ranks tell more where candidates are many, returns where they are few.
    is_more(returns) || (blocks >= FEWEST_BLOCKS && ranks.is_some_and(is_more))
}

/// By how many ranks the first of two candidates is ahead of the second, over kinds of models, with the jackknife's interval over blocks.
/// Of `ranks`, `[kinds × blocks][candidates]`.
pub(super) fn ranks_ahead(
    ranks: &[Vec<usize>],
    [first, second]: [usize; 2],
    blocks: usize,
) -> Result<Option<Difference>, StatsError> {
    let kinds = (ranks.len() / blocks) as f64;
    let of_block = |candidate: usize| -> Vec<f64> {
        (0..blocks)
            .map(|block| ranks.iter().skip(block).step_by(blocks))
            .map(|of_kinds| of_kinds.map(|ranks| ranks[candidate] as f64).sum::<f64>() / kinds)
            .collect()
    };
    beyond(&of_block(second), &of_block(first))
}

/// Whether a difference is surely above 0: by its interval, or because the other diverged.
fn is_more(difference: Difference) -> bool {
    difference.mean == f64::INFINITY
        || difference.interval.is_some_and(|interval| interval.low > 0.0)
}
