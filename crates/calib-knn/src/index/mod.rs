//! Exact search: one interface and several structures.

mod build;
mod join;
mod kd_tree;
mod linear;
mod neighbor_lists;
mod pending;
mod query;
mod scan;

pub use build::Planned;
pub use join::Join;
pub(crate) use join::{image_width, leaves};
pub use kd_tree::KdTree;
pub(crate) use linear::{covariance, leading_axes, mean};
pub use neighbor_lists::NeighborLists;
pub(crate) use neighbor_lists::filled;
pub use query::{Queries, Sources};
pub use scan::Scan;

use calib_core::Monitor;
use rayon::prelude::*;

use crate::{KnnError, Lists};

/// An exact search structure over the sources of a model.
///
/// For every query and every member that the query belongs to, `search` finds the `k` nearest sources among the member's
/// transitions outside the query's forbidden range. The order is defined by the squared distance `Σ_c (a_c − b_c)²` in f64 in
/// column order, ties by row. So all structures give the same lists, for any number of threads. Where fewer than `k` sources are
/// admissible, the list is shorter.
pub trait NeighborIndex: Sync {
    /// Returns all queries, in the order in which they are best searched.
    fn order(&self, queries: &Queries<'_>) -> Vec<u32> {
        (0..queries.len() as u32).collect()
    }

    /// Finds the lists of the queries `order`, a part of [`order`](Self::order), and stores them at the same positions in
    /// `found`. Progress counts queries.
    ///
    /// # Errors
    /// [`KnnError::Cancelled`] if the monitor interrupts; some lists are then missing.
    fn search(
        &self,
        queries: &Queries<'_>,
        order: &[u32],
        found: &mut NeighborLists,
        monitor: &dyn Monitor,
    ) -> Result<(), KnnError>;
}

/// Searches `order` in parallel in blocks of `size` queries, and stores the lists of each block at its positions. `search`
/// reports progress to the monitor. Results that are found after an interruption are not used.
fn in_blocks<L: Lists>(
    order: &[u32],
    size: usize,
    found: &mut NeighborLists,
    monitor: &dyn Monitor,
    search: impl Fn(&[u32]) -> Vec<L> + Sync,
) -> Result<(), KnnError> {
    let pieces = found.pieces(order.chunks(size).map(<[u32]>::len));
    pieces.zip(order.par_chunks(size)).for_each(|(mut piece, order)| {
        if monitor.interrupted() {
            return;
        }
        for (place, lists) in search(order).iter().enumerate() {
            piece.store(place, lists);
        }
    });
    Ok(monitor.check()?)
}

/// Runs `op` with every instruction set of this processor.
#[cfg(test)]
pub(crate) fn at_every_level<Op: pulp::WithSimd + Copy>(op: Op) -> Vec<Op::Output> {
    let mut outputs = vec![op.with_simd(pulp::Scalar)];
    #[cfg(target_arch = "x86_64")]
    {
        use pulp::x86;
        outputs.extend(x86::V3::try_new().map(|level| pulp::Simd::vectorize(level, op)));
        outputs.extend(x86::V4::try_new().map(|level| pulp::Simd::vectorize(level, op)));
    }
    #[cfg(target_arch = "aarch64")]
    {
        use pulp::aarch64;
        outputs.extend(aarch64::Neon::try_new().map(|level| pulp::Simd::vectorize(level, op)));
    }
    outputs
}
