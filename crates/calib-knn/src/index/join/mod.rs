use calib_core::Monitor;
use pulp::Arch;
use rayon::prelude::*;

mod block;
mod embedding;
mod kernel;
mod linear;
mod tree;

use super::{NeighborIndex, Queries, Sink, Sources, pending::Pool};
use crate::{KnnError, distance::Margin, groups::Groups};
use block::{Block, Found, QUERIES};
use embedding::Embedding;
use tree::{LEAF, Tree};

/// Blocks between two looks at the monitor.
const GROUP: usize = 64;
/// Blocks by which the work is judged.
const SAMPLE: usize = 12;
/// Beyond this distance from the mean f32 images could overflow.
const FARTHEST: f64 = 1e15;

/// An exact join of queries and sources, for data in which most sources can be ruled out unseen.
///
/// The different source states are mapped into at most 32 dimensions by a map that lengthens no distance, and
/// sorted into leaves of near neighbours with a tree of boxes over them. Queries are searched in blocks of one
/// leaf: the boxes nearest to the block first, until they are further than any query's `k`-th neighbour. Sources
/// whose images are near enough are computed in f32, and those within the margin of f32 by the definition.
#[derive(Debug)]
pub struct Join<'a> {
    sources: Sources<'a>,
    groups: Groups,
    embedding: Embedding,
    tree: Tree,
    /// Where in the order of the tree the source of each transition lies.
    place_of: Vec<u32>,
    image_margin: Margin,
    state_margin: Margin,
    /// The largest distance of a source from the mean.
    norm: f64,
}

impl<'a> Join<'a> {
    /// Map and sort the sources; `None` if their values are too large for images in f32.
    pub fn new(sources: Sources<'a>) -> Option<Self> {
        let groups = Groups::new(&sources);
        let embedding = Embedding::new(&sources, &groups);
        let width = embedding.width();
        let mut images = vec![0.0; groups.len() * width];
        let norm = images
            .par_chunks_exact_mut(width)
            .enumerate()
            .map(|(group, image)| embedding.map(sources.state(groups.first(group)), image))
            .reduce(|| 0.0, f64::max);
        if norm > FARTHEST {
            return None;
        }
        let tree = Tree::new(&images, width);
        let mut place_of = vec![0; sources.len()];
        for (place, &group) in tree.order().iter().enumerate() {
            for &transition in groups.transitions(group as usize) {
                place_of[transition as usize] = place as u32;
            }
        }
        let image_margin = Margin::new(width);
        let state_margin = Margin::new(sources.columns());
        Some(Self { sources, groups, embedding, tree, place_of, image_margin, state_margin, norm })
    }

    fn pool(&self) -> Pool<'_> {
        Pool { sources: &self.sources, groups: &self.groups, margin: self.state_margin }
    }

    /// The leaf near which the query lies: that of its own row if it is a source.
    fn leaf(&self, queries: &Queries<'_>, query: usize) -> usize {
        if let Some(transition) = queries.own_transition(query) {
            return self.tree.leaf_of(self.place_of[transition as usize] as usize).0;
        }
        let mut image = vec![0.0; self.embedding.width()];
        self.embedding.map(queries.states().row(queries.row(query)), &mut image);
        self.tree.nearest_leaf(&image)
    }

    /// The queries with their leaves, leaf by leaf.
    fn place(&self, queries: &Queries<'_>) -> Vec<(u32, u32)> {
        let mut placed: Vec<(u32, u32)> = (0..queries.len())
            .into_par_iter()
            .map(|query| (self.leaf(queries, query) as u32, query as u32))
            .collect();
        placed.par_sort_unstable();
        placed
    }

    fn block<'b>(
        &'b self,
        placed: &'b [(u32, u32)],
        queries: &'b Queries<'b>,
        k: usize,
    ) -> Block<'b> {
        Block { join: self, queries, placed, leaf: placed[0].0 as usize, k }
    }

    /// Whether the join is less work than a scan, judged by a few of the queries.
    pub(super) fn pays(&self, queries: &Queries<'_>, k: usize) -> bool {
        let placed = self.place(queries);
        let blocks: Vec<&[(u32, u32)]> = blocks(&placed).collect();
        let sample: Vec<&[(u32, u32)]> =
            blocks.iter().copied().step_by(blocks.len().div_ceil(SAMPLE).max(1)).collect();
        let sampled: usize = sample.iter().map(|block| block.len()).sum();
        let arch = Arch::new();
        let work: u64 =
            sample.par_iter().map(|block| arch.dispatch(self.block(block, queries, k)).work).sum();
        let scan = sampled as u64 * (self.sources.len() * self.sources.columns()) as u64;
        work <= scan
    }

    /// Write the image of a query; returns a bound on its distance from the mean.
    fn image(&self, queries: &Queries<'_>, query: usize, image: &mut [f32]) -> f64 {
        let Some(transition) = queries.own_source(query) else {
            return self.embedding.map(queries.states().row(queries.row(query)), image);
        };
        let (leaf, lane) = self.tree.leaf_of(self.place_of[transition as usize] as usize);
        let lanes = self.tree.lanes(leaf).iter().skip(lane).step_by(LEAF);
        for (coordinate, &value) in image.iter_mut().zip(lanes) {
            *coordinate = value;
        }
        self.norm
    }
}

impl NeighborIndex for Join<'_> {
    fn search(
        &self,
        queries: &Queries<'_>,
        k: usize,
        sink: &mut Sink<'_>,
        monitor: &dyn Monitor,
    ) -> Result<(), KnnError> {
        let placed = self.place(queries);
        let blocks: Vec<&[(u32, u32)]> = blocks(&placed).collect();
        let arch = Arch::new();
        for group in blocks.chunks(GROUP) {
            if monitor.interrupted() {
                return Err(KnnError::Interrupted);
            }
            let found: Vec<Found> = group
                .par_iter()
                .map(|block| arch.dispatch(self.block(block, queries, k)))
                .collect();
            for (block, found) in group.iter().zip(&found) {
                for (&(_, query), lists) in block.iter().zip(&found.lists) {
                    sink(query as usize, lists);
                }
                monitor.advance(block.len() as u64);
            }
        }
        Ok(())
    }
}

/// Runs of queries of one leaf, at most [`QUERIES`] long.
fn blocks(placed: &[(u32, u32)]) -> impl Iterator<Item = &[(u32, u32)]> {
    placed.chunk_by(|a, b| a.0 == b.0).flat_map(|run| run.chunks(QUERIES))
}
