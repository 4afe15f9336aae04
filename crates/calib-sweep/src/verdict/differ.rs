//! Whether settings differ at all.

use calib_stats::Selection;

/// Whether any of these differ. True for a single one.
pub(super) fn differ<T: PartialEq>(all: &[T]) -> bool {
    all.len() < 2 || all.windows(2).any(|pair| pair[0] != pair[1])
}

/// Whether the members prefer any setting to another, by worst rank or at least by mean rank.
pub(super) fn told_apart(selection: &Selection) -> bool {
    let ranks: Vec<_> = selection.worst_ranks.iter().zip(&selection.mean_ranks).collect();
    differ(&ranks)
}
