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

impl<'a> Sources<'a> {
    /// The search structure of this kind over these sources.
    ///
    /// # Errors
    /// If the k-d tree is asked for more columns than it supports.
    pub fn index(&self, kind: IndexKind) -> Result<Box<dyn NeighborIndex + 'a>, KnnError> {
        match kind {
            IndexKind::Auto | IndexKind::Join => Ok(match Join::new(*self) {
                Some(join) => Box::new(join),
                None => Box::new(Scan::new(*self)),
            }),
            IndexKind::Scan => Ok(Box::new(Scan::new(*self))),
            IndexKind::KdTree => Ok(Box::new(KdTree::new(*self)?)),
        }
    }
}
