use calib_core::Monitor;
use calib_files::{Scratch, ScratchPlace};
use pulp::Arch;
use rayon::prelude::*;

mod block;
mod embedding;
mod kernel;
mod tree;

use super::{Found, NeighborIndex, Queries, Sources, going_on, pending::Pool};
use crate::{KnnError, distance::Margin, groups::Groups};
use block::{Band, Limit, QUERIES};
use embedding::Embedding;
pub(crate) use embedding::width as image_width;
use tree::Tree;
pub(crate) use tree::{LEAF, leaves};

/// Sources between two looks at the monitor while the images are made.
const CHUNK: usize = 1 << 12;
/// Leaves of a band: its queries share what is read of other leaves.
const BAND: usize = 8;
/// Bands by which the work is judged.
const SAMPLE: usize = 12;
/// Beyond this distance from the mean f32 images could overflow.
const FARTHEST: f64 = 1e15;

/// Place of a transition that cannot be a neighbour.
const ELSEWHERE: u32 = u32::MAX;

/// An exact join of queries and sources, for data in which most sources can be ruled out unseen.
///
/// The different source states are mapped into at most 32 dimensions by a map that lengthens no distance, and
/// sorted into leaves of near neighbours with a tree of boxes over them. Queries are searched in blocks of one
/// leaf: the boxes nearest to the block first, until they are further than any query's `k`-th neighbour. Sources
/// whose images are near enough are computed in f32, and those within the margin of f32 by the definition.
#[derive(Debug)]
pub struct Join<'a> {
    sources: Sources<'a>,
    /// Different states, in the order of the tree.
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
    /// Map and sort the sources; `None` if their values are too large for images in f32. Images live in `place`.
    /// Progress counts four passes over the sources.
    ///
    /// # Errors
    /// If there is no place for the images, or the monitor interrupts.
    pub fn new(
        sources: Sources<'a>,
        place: &ScratchPlace,
        monitor: &dyn Monitor,
    ) -> Result<Option<Self>, KnnError> {
        monitor.begin("neighbour index", 4 * sources.len() as u64);
        let groups = Groups::new(&sources, monitor)?;
        let embedding = Embedding::new(&sources, &groups);
        let width = embedding.width();
        let mut images = Scratch::zeroed(groups.len() * width, place)?;
        let norm = images
            .par_chunks_mut(CHUNK * width)
            .enumerate()
            .map(|(number, chunk)| {
                if monitor.interrupted() {
                    return 0.0;
                }
                let images = chunk.chunks_exact_mut(width);
                let count = images.len() as u64;
                let norm = (number * CHUNK..).zip(images).fold(0.0, |norm: f64, (group, image)| {
                    norm.max(embedding.map(sources.states().row(groups.row(group)), image))
                });
                monitor.advance(count);
                norm
            })
            .reduce(|| 0.0, f64::max);
        going_on(monitor)?;
        if norm > FARTHEST {
            return Ok(None);
        }
        let (tree, order) = Tree::new(&images, width, place, monitor)?;
        drop(images);
        let groups = groups.in_order(&order);
        drop(order);
        let mut place_of = vec![ELSEWHERE; sources.len()];
        for place in 0..groups.len() {
            for &transition in groups.transitions(place) {
                place_of[transition as usize] = place as u32;
            }
        }
        let image_margin = Margin::new(width);
        let state_margin = Margin::new(sources.columns());
        Ok(Some(Self {
            sources,
            groups,
            embedding,
            tree,
            place_of,
            image_margin,
            state_margin,
            norm,
        }))
    }

    fn pool(&self) -> Pool<'_> {
        Pool { sources: &self.sources, groups: &self.groups, margin: self.state_margin }
    }

    /// The leaf near which the query lies: that of its own row if it is a source.
    fn leaf(&self, queries: &Queries<'_>, query: usize) -> usize {
        if let Some(transition) = queries.own_transition(query) {
            // A transition that cannot be a neighbour lies near the last one that can.
            let transition = self.sources.candidates().near(transition);
            return self.tree.leaf_of(self.place_of[transition as usize] as usize).0;
        }
        let mut image = vec![0.0; self.embedding.width()];
        self.embedding.map(queries.states().row(queries.row(query)), &mut image);
        self.tree.nearest_leaf(&image)
    }

    /// Runs of `order` that lie in one leaf, at most [`QUERIES`] long, with the leaf; band by band.
    fn bands<'o>(&self, queries: &Queries<'_>, order: &'o [u32]) -> Vec<Vec<(usize, &'o [u32])>> {
        let leaves: Vec<usize> =
            order.par_iter().map(|&query| self.leaf(queries, query as usize)).collect();
        let mut bands = Vec::new();
        let mut rest = order;
        for band in leaves.chunk_by(|a, b| a / BAND == b / BAND) {
            let mut blocks = Vec::new();
            for run in band.chunk_by(|a, b| a == b) {
                let (own, after) = rest.split_at(run.len());
                blocks.extend(own.chunks(QUERIES).map(|part| (run[0], part)));
                rest = after;
            }
            // Many queries of one leaf, as where they come from elsewhere, are many bands.
            bands.extend(blocks.chunks(2 * BAND * LEAF / QUERIES).map(<[_]>::to_vec));
        }
        bands
    }

    fn limit(&self) -> Limit {
        let leaves = match self.sources.leaf_budget() {
            0 => usize::MAX,
            budget => budget,
        };
        Limit { work: u64::MAX, leaves }
    }

    /// The work of the join as a share of that of a scan, judged by a few of the queries; it is not looked into how
    /// much more than twice the work the join would be.
    pub(super) fn share_of_scan(&self, queries: &Queries<'_>, order: &[u32], k: usize) -> f64 {
        let bands = self.bands(queries, order);
        let stride = bands.len().div_ceil(SAMPLE).max(1);
        let sample: Vec<_> = bands.iter().step_by(stride).map(|band| &band[..1]).collect();
        let arch = Arch::new();
        let scan = |queries: usize| (queries * self.groups.len() * self.sources.columns()) as u64;
        let (work, sampled) = sample
            .par_iter()
            .map(|blocks| {
                let count = blocks[0].1.len();
                let limit = Limit { work: 2 * scan(count), ..self.limit() };
                let band = Band { join: self, queries, blocks, k, limit };
                (arch.dispatch(band).work, count)
            })
            .reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        work as f64 / scan(sampled).max(1) as f64
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
    /// Leaf by leaf.
    fn order(&self, queries: &Queries<'_>) -> Vec<u32> {
        let mut placed: Vec<(u32, u32)> = (0..queries.len())
            .into_par_iter()
            .map(|query| (self.leaf(queries, query) as u32, query as u32))
            .collect();
        placed.par_sort_unstable();
        placed.into_iter().map(|(_, query)| query).collect()
    }

    fn search(
        &self,
        queries: &Queries<'_>,
        order: &[u32],
        found: &mut Found,
        monitor: &dyn Monitor,
    ) -> Result<(), KnnError> {
        let (k, arch) = (found.k(), Arch::new());
        let bands = self.bands(queries, order);
        let length = |band: &Vec<(usize, &[u32])>| band.iter().map(|(_, run)| run.len()).sum();
        let pieces = found.pieces(bands.iter().map(length));
        pieces.zip(&bands).for_each(|(mut piece, blocks)| {
            if monitor.interrupted() {
                return;
            }
            let searched =
                arch.dispatch(Band { join: self, queries, blocks, k, limit: self.limit() });
            for (place, lists) in searched.lists.iter().enumerate() {
                piece.store(place, lists);
            }
            monitor.advance(searched.lists.len() as u64);
        });
        going_on(monitor)
    }
}
