use std::num::NonZero;

use calib_core::Monitor;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use super::{NeighborIndex, NeighborLists, Queries, Sources, in_blocks};
use crate::{KnnError, Lists as _, MemberLists, distance::squared, groups::Groups};

/// Queries per block, between two checks for an interruption.
const QUERIES: usize = 256;
/// Maximum number of queries from which the number of returned states is estimated.
const SAMPLE: usize = 256;

/// A k-d tree (the kiddo crate) over the distinct source states, for few columns.
///
/// The tree returns the `n` nearest states. Every other state is at least as far as the last one returned. If strictly nearer states
/// fill every list of the query, the lists are exact; otherwise `n` grows. Distances are computed again by the definition.
///
/// The tree cannot skip states that the query must not find, such as those of a Theiler window or of a block that is left out. It
/// returns all of them where they are the nearest. It has no lists for classes.
#[derive(Debug)]
pub struct KdTree<'a> {
    sources: Sources<'a>,
    groups: Groups,
    tree: Box<dyn Tree>,
}

impl<'a> KdTree<'a> {
    /// Maximum number of columns that the tree supports.
    pub const MAX_COLUMNS: usize = 8;

    /// Builds the tree. Progress counts each source twice.
    ///
    /// # Errors
    /// If the states have more than [`MAX_COLUMNS`](Self::MAX_COLUMNS) columns, or the monitor interrupts.
    pub fn new(sources: Sources<'a>, monitor: &dyn Monitor) -> Result<Self, KnnError> {
        let columns = sources.columns();
        if columns > Self::MAX_COLUMNS {
            return Err(KnnError::Dimensions { columns, max: Self::MAX_COLUMNS });
        }
        monitor.begin("neighbour index", 2 * sources.len() as u64);
        let groups = Groups::new(&sources, monitor)?;
        let tree: Box<dyn Tree> = match columns {
            0 | 1 => Fixed::<1>::boxed(&sources, &groups),
            2 => Fixed::<2>::boxed(&sources, &groups),
            3 => Fixed::<3>::boxed(&sources, &groups),
            4 => Fixed::<4>::boxed(&sources, &groups),
            5 => Fixed::<5>::boxed(&sources, &groups),
            6 => Fixed::<6>::boxed(&sources, &groups),
            7 => Fixed::<7>::boxed(&sources, &groups),
            _ => Fixed::<8>::boxed(&sources, &groups),
        };
        monitor.advance(sources.len() as u64);
        Ok(Self { sources, groups, tree })
    }

    /// Returns the lists of a query, and how many states the tree returned for them. Stops early once there are more than `most`.
    fn fill(
        &self,
        queries: &Queries<'_>,
        query: usize,
        k: usize,
        most: usize,
    ) -> (MemberLists, usize) {
        let findable = queries.findable();
        let state = queries.states().row(queries.row(query));
        let forbidden = queries.forbidden(query);
        let mut lists = MemberLists::new(findable.members(), k);
        let mut asked = k + 1;
        let mut given = 0;
        loop {
            lists.reset(queries.wanted(query));
            let found = self.tree.nearest(state, asked);
            given += found.len();
            for &(_, group) in &found {
                let source = self.groups.row(group as usize);
                let squared = squared(state, self.sources.states.row(source));
                self.groups.offer(group as usize, squared, &forbidden, 0, &mut lists, findable);
            }
            // The tree computes in f64 without cancellation. Its relative error is far smaller than this.
            let beyond = found.last().map_or(f64::INFINITY, |&(last, _)| last * (1.0 - 1e-12));
            if found.len() == self.groups.len() || lists.radius() < beyond || given > most {
                return (lists, given);
            }
            asked = (4 * asked).min(self.groups.len());
        }
    }

    /// Estimates how many states the tree returns per query, from an evenly spread sample of the queries. For one query it counts
    /// little further than `most`.
    pub(super) fn given(&self, queries: &Queries<'_>, k: usize, most: usize) -> f64 {
        let stride = queries.len().div_ceil(SAMPLE).max(1);
        let sample: Vec<usize> = (0..queries.len()).step_by(stride).collect();
        let given: usize =
            sample.par_iter().map(|&query| self.fill(queries, query, k, most).1).sum();
        given as f64 / sample.len().max(1) as f64
    }
}

impl NeighborIndex for KdTree<'_> {
    fn search(
        &self,
        queries: &Queries<'_>,
        order: &[u32],
        found: &mut NeighborLists,
        monitor: &dyn Monitor,
    ) -> Result<(), KnnError> {
        let k = found.k();
        in_blocks(order, QUERIES, found, monitor, |order| {
            let lists = order
                .iter()
                .map(|&query| self.fill(queries, query as usize, k, usize::MAX).0)
                .collect();
            monitor.advance(order.len() as u64);
            lists
        })
    }
}

/// A tree of any compiled dimension.
trait Tree: Send + Sync + std::fmt::Debug {
    /// Returns the `count` nearest groups with their squared distances, nearest first.
    fn nearest(&self, state: &[f32], count: usize) -> Vec<(f64, u32)>;
}

/// A tree of `K` dimensions. States without columns are points on a line.
#[derive(Debug)]
struct Fixed<const K: usize>(ImmutableKdTree<f32, K>);

impl<const K: usize> Fixed<K> {
    fn boxed(sources: &Sources<'_>, groups: &Groups) -> Box<dyn Tree>
    where
        Self: Tree + 'static,
    {
        let points: Vec<[f32; K]> =
            (0..groups.len()).map(|group| pad(sources.states.row(groups.row(group)))).collect();
        let tree = ImmutableKdTree::new_from_slice(&points)
            .expect("different points can be split, and transitions are counted in 32 bits");
        Box::new(Self(tree))
    }
}

fn pad<const K: usize>(state: &[f32]) -> [f32; K] {
    std::array::from_fn(|column| state.get(column).map_or(0.0, |value| value + 0.0))
}

impl<const K: usize> Tree for Fixed<K> {
    fn nearest(&self, state: &[f32], count: usize) -> Vec<(f64, u32)> {
        let Some(count) = NonZero::new(count) else { return Vec::new() };
        self.0
            .query(&pad(state))
            .nearest_n::<SquaredEuclidean<f64>>(count)
            .execute()
            .into_iter()
            .map(|found| (found.distance, found.item))
            .collect()
    }
}
