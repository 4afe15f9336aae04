//! Exact search, one contract and several structures.

mod join;
mod kd_tree;
mod pending;
mod product;
mod query;
mod scan;

pub use join::Join;
pub use kd_tree::KdTree;
pub use query::{Queries, Sources};
pub use scan::Scan;

use calib_core::Monitor;

use crate::{IndexKind, KnnError, MemberLists};

/// Receives the lists of query `query`; called on the calling thread, once a query, in no particular order.
pub type Sink<'a> = dyn FnMut(usize, &MemberLists) + 'a;

/// An exact search structure over the sources of a model.
///
/// For every query and every member that the query belongs to, `search` finds the `k` nearest sources among
/// the member's transitions outside the query's forbidden range. The order is defined by the squared
/// distance `Σ_c (a_c − b_c)²` in f64 in column order, ties by row. So all structures give the same lists,
/// whatever the number of threads. Where fewer than `k` sources are admissible the list is shorter.
pub trait NeighborIndex: Sync {
    /// Find the lists of all `queries`; hand each to `sink`. Progress is counted in queries.
    ///
    /// # Errors
    /// [`KnnError::Interrupted`] if the monitor says so; the sink has then seen some of the queries.
    fn search(
        &self,
        queries: &Queries<'_>,
        k: usize,
        sink: &mut Sink<'_>,
        monitor: &dyn Monitor,
    ) -> Result<(), KnnError>;
}

/// Up to this many columns the k-d tree is the faster of the two; see [`Sources::index`].
const FEW_COLUMNS: usize = 3;
/// Fewer queries than this are not worth building anything for.
const FEW_QUERIES: usize = 256;

impl<'a> Sources<'a> {
    /// A search structure of this kind over these sources.
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
    /// # Errors
    /// If the k-d tree is asked for more columns than it supports.
    pub fn index(
        &self,
        kind: IndexKind,
        queries: &Queries<'_>,
        k: usize,
    ) -> Result<Box<dyn NeighborIndex + 'a>, KnnError> {
        Ok(match kind {
            IndexKind::KdTree => Box::new(KdTree::new(*self)?),
            IndexKind::Scan => Box::new(Scan::new(*self)),
            IndexKind::Auto if queries.len() < FEW_QUERIES => Box::new(Scan::new(*self)),
            IndexKind::Auto if self.columns() <= FEW_COLUMNS => Box::new(KdTree::new(*self)?),
            IndexKind::Auto => match Join::new(*self) {
                Some(join) if join.pays(queries, k) => Box::new(join),
                _ => Box::new(Scan::new(*self)),
            },
            IndexKind::Join => match Join::new(*self) {
                Some(join) => Box::new(join),
                None => Box::new(Scan::new(*self)),
            },
        })
    }
}
