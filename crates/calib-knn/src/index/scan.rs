use calib_core::Monitor;
use pulp::Arch;
use rayon::prelude::*;

use super::{NeighborIndex, Queries, Sink, Sources};
use crate::{
    KnnError, MemberLists,
    distance::{Margin, squared},
    lists::Candidate,
};

/// Sources side by side in a tile: the width of the innermost loop.
const TILE: usize = 64;
/// Queries that share a pass over the sources.
const QUERIES: usize = 128;
/// Queries between two looks at the monitor.
const GROUP: usize = 16 * QUERIES;

/// An exact blocked scan: every query meets every source, a tile at a time.
///
/// Distances are approximated in f32 for a whole tile; pairs that could belong to a list, by a margin that
/// covers the rounding, are computed again by the definition.
#[derive(Clone, Copy, Debug)]
pub struct Scan<'a> {
    sources: Sources<'a>,
}

impl<'a> Scan<'a> {
    /// A scan of these sources; nothing is built.
    pub fn new(sources: Sources<'a>) -> Self {
        Self { sources }
    }

    /// The lists of queries `first..first + count`.
    fn block(
        &self,
        queries: &Queries<'_>,
        first: usize,
        count: usize,
        k: usize,
    ) -> Vec<MemberLists> {
        let blocks = self.sources.blocks();
        let mut lists: Vec<MemberLists> = (first..first + count)
            .map(|query| {
                let mut lists = MemberLists::new(blocks.members(), k);
                lists.reset(queries.wanted(query));
                lists
            })
            .collect();
        let forbidden: Vec<_> =
            (first..first + count).map(|query| queries.forbidden(query)).collect();
        let margin = Margin::new(self.sources.columns());
        let states = self.sources.states().as_slice();
        let columns = self.sources.columns();
        let rows = self.sources.transitions().sources();
        let arch = Arch::new();
        let mut tile = vec![0.0_f32; columns * TILE];
        let mut distances = [0.0_f32; TILE];
        for start in (0..rows.len()).step_by(TILE) {
            let width = TILE.min(rows.len() - start);
            for (lane, &row) in rows[start..start + width].iter().enumerate() {
                let state = &states[row as usize * columns..][..columns];
                for (column, &value) in state.iter().enumerate() {
                    tile[column * TILE + lane] = value;
                }
            }
            for offset in 0..count {
                let query = queries.states().row(queries.row(first + offset));
                arch.dispatch(|| tile_distances(query, &tile, &mut distances));
                let lists = &mut lists[offset];
                let mut threshold = margin.threshold(lists.radius());
                for lane in 0..width {
                    let transition = (start + lane) as u32;
                    // Not a number only where f32 overflowed; the definition then decides.
                    let beyond = distances[lane] > threshold;
                    if beyond || forbidden[offset].contains(&transition) {
                        continue;
                    }
                    let row = rows[start + lane] as usize;
                    let squared = squared(query, &states[row * columns..][..columns]);
                    lists.offer(Candidate { squared, transition }, blocks);
                    threshold = margin.threshold(lists.radius());
                }
            }
        }
        lists
    }
}

/// `distances[t] ≈ Σ_c (query[c] − tile[c][t])²`.
#[inline(always)]
#[expect(clippy::inline_always, reason = "takes the caller's instruction set")]
fn tile_distances(query: &[f32], tile: &[f32], distances: &mut [f32; TILE]) {
    let mut sums = [0.0_f32; TILE];
    for (&value, sources) in query.iter().zip(tile.as_chunks::<TILE>().0) {
        for (sum, &source) in sums.iter_mut().zip(sources) {
            let difference = value - source;
            *sum += difference * difference;
        }
    }
    *distances = sums;
}

impl NeighborIndex for Scan<'_> {
    fn search(
        &self,
        queries: &Queries<'_>,
        k: usize,
        sink: &mut Sink<'_>,
        monitor: &dyn Monitor,
    ) -> Result<(), KnnError> {
        let total = queries.len();
        for group in (0..total).step_by(GROUP) {
            if monitor.interrupted() {
                return Err(KnnError::Interrupted);
            }
            let end = total.min(group + GROUP);
            let starts: Vec<usize> = (group..end).step_by(QUERIES).collect();
            let found: Vec<Vec<MemberLists>> = starts
                .par_iter()
                .map(|&start| self.block(queries, start, QUERIES.min(end - start), k))
                .collect();
            for (query, lists) in (group..).zip(found.iter().flatten()) {
                sink(query, lists);
            }
            monitor.advance((end - group) as u64);
        }
        Ok(())
    }
}
