use std::ops::Range;

/// The rows of the training log that the predictors of a run may be fitted on.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum FittingRows {
    /// All rows: the run uses later data.
    All,
    /// All rows except these, which the run replays.
    AllBut(Vec<Range<usize>>),
    /// Only the block that this member of a leave-one-block-out ensemble was not trained on.
    Only(Range<usize>),
}

impl FittingRows {
    /// Returns the row ranges to leave out of a log of `rows` rows.
    pub(crate) fn excluded(&self, rows: usize) -> Vec<Range<usize>> {
        match self {
            Self::All => Vec::new(),
            Self::AllBut(ranges) => ranges.clone(),
            Self::Only(range) => vec![0..range.start, range.end..rows],
        }
    }
}
