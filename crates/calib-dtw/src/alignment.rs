//! A distance with its path.

use crate::Distance;

/// A distance and its path.
#[derive(Clone, Debug, PartialEq)]
pub struct Alignment {
    /// The distance.
    pub distance: Distance,
    /// Matched samples (query, reference) from begin to end. A branch of several steps lists every cell whose cost it adds. Cells that a
    /// step skips are not listed.
    pub path: Vec<(usize, usize)>,
}
