use calib_core::Monitor;
use calib_files::ScratchPlace;

use super::{Join, KdTree, NeighborIndex, Queries, Scan, Sources};
use crate::{IndexChoice, IndexKind, KnnError, choice::Reason};

/// Up to this many columns the k-d tree is the faster of the two; see [`Sources::index`].
const FEW_COLUMNS: usize = 3;
/// Fewer queries than this are not worth building anything for.
const FEW_QUERIES: usize = 256;

/// A search structure that is ready for some queries.
#[expect(missing_debug_implementations, reason = "a trait object of any structure")]
pub struct Planned<'a> {
    /// The structure.
    pub index: Box<dyn NeighborIndex + 'a>,
    /// The queries in the order in which it searches them.
    pub order: Vec<u32>,
    /// Which structure it is, and why.
    pub choice: IndexChoice,
}

impl<'a> Planned<'a> {
    fn new(
        index: impl NeighborIndex + 'a,
        queries: &Queries<'_>,
        kind: IndexKind,
        reason: Reason,
    ) -> Self {
        let order = index.order(queries);
        Self { index: Box::new(index), order, choice: IndexChoice { kind, reason } }
    }
}

impl<'a> Sources<'a> {
    /// A search structure of this kind over these sources, with its large arrays in `place`.
    ///
    /// [`IndexKind::Auto`] takes the scan for few queries, else the k-d tree up to 3 columns, else the join,
    /// unless that turns out on a sample of the queries to be more work than the scan. Processor seconds for the
    /// tables of 100 000 rows (`k` = 3, five members; `cargo bench -p calib-knn` measures them anew):
    ///
    /// | columns | uniform: tree, join | simulated plant: tree, join |
    /// |---|---|---|
    /// | 1 | 0.22, 0.46 | 0.13, 0.24 |
    /// | 2 | 0.32, 0.40 | 0.20, 0.22 |
    /// | 3 | 0.46, 0.43 | 0.19, 0.18 |
    /// | 4 | 0.65, 0.45 | 0.27, 0.19 |
    /// | 6 | 1.2, 0.63 | 0.42, 0.17 |
    /// | 8 | 2.9, 1.0 | 0.76, 0.20 |
    /// | 16 | 84, 3.7 | 7.6, 0.22 |
    ///
    /// Progress counts passes over the sources.
    ///
    /// # Errors
    /// If the k-d tree is asked for more columns than it supports, there is no place for the arrays, or the
    /// monitor interrupts.
    pub fn index(
        &self,
        kind: IndexKind,
        queries: &Queries<'_>,
        k: usize,
        place: &ScratchPlace,
        monitor: &dyn Monitor,
    ) -> Result<Planned<'a>, KnnError> {
        let scan = |reason| Planned::new(Scan::new(*self), queries, IndexKind::Scan, reason);
        let tree = |reason| -> Result<_, KnnError> {
            Ok(Planned::new(KdTree::new(*self, monitor)?, queries, IndexKind::KdTree, reason))
        };
        let budget = self.leaf_budget();
        // A budget is the join's, so that the tables do not depend on what else could be taken.
        let kind = if budget > 0 { IndexKind::Join } else { kind };
        match kind {
            IndexKind::KdTree => tree(Reason::Asked),
            IndexKind::Scan => Ok(scan(Reason::Asked)),
            IndexKind::Auto if queries.len() < FEW_QUERIES => Ok(scan(Reason::FewQueries)),
            IndexKind::Auto if self.columns() <= FEW_COLUMNS => {
                tree(Reason::FewColumns { columns: self.columns() })
            }
            IndexKind::Join | IndexKind::Auto => {
                let Some(join) = Join::new(*self, place, monitor)? else {
                    return Ok(scan(Reason::Large));
                };
                let order = join.order(queries);
                let mut reason = Reason::Asked;
                if kind == IndexKind::Auto {
                    let share = join.share_of_scan(queries, &order, k);
                    reason = Reason::Work { share };
                    if share > 1.0 {
                        return Ok(scan(reason));
                    }
                }
                let choice = IndexChoice { kind: IndexKind::Join, reason };
                Ok(Planned { index: Box::new(join), order, choice })
            }
        }
    }
}
