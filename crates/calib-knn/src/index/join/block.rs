//! The search of one block of queries that lie near each other.

#![expect(
    clippy::inline_always,
    reason = "inner loops must take the instruction set of the function that calls them"
)]

use std::{cmp::Reverse, collections::BinaryHeap};

use pulp::{Simd, WithSimd};

use super::{
    Join,
    kernel::{box_to_box, box_to_lanes, lane_distances},
    tree::{Below, LEAF},
};
use crate::{
    MemberLists,
    index::{Queries, pending::Pending},
};

/// Most queries of a block.
pub(super) const QUERIES: usize = 64;

// What a coordinate costs beside a multiply-add of a matrix product, roughly and as measured once.
// A state is read from anywhere in memory.
const BOX_COST: usize = 8;
const LEAF_COST: usize = 2;
const STATE_COST: u64 = 32;

/// A block of queries of one leaf.
pub(super) struct Block<'a> {
    pub(super) join: &'a Join<'a>,
    pub(super) queries: &'a Queries<'a>,
    /// Which queries, at most [`QUERIES`].
    pub(super) order: &'a [u32],
    /// The leaf that they lie in.
    pub(super) leaf: usize,
    pub(super) k: usize,
}

/// What is known about the queries of a block while leaves are visited.
struct Progress<'a> {
    one: Vec<One<'a>>,
    /// Images `[query, coordinate]`.
    images: Vec<f32>,
    /// Images `[coordinate, query]`.
    lanes: Vec<f32>,
    /// A box around the images.
    bounds: (Vec<f32>, Vec<f32>),
    /// Images beyond this squared distance need not be looked at; negative past the last query.
    thresholds: [f32; QUERIES],
    /// Work on boxes and images so far; see [`Searched`].
    work: u64,
}

/// What is known about one query.
struct One<'a> {
    pending: Pending<'a>,
    /// By how much images may be further apart than states.
    slack: f64,
}

/// The lists of a block, in the order of its queries, and what they cost.
pub(super) struct Searched {
    pub(super) lists: Vec<MemberLists>,
    /// Work in multiply-adds, where each kind of work counts by the time that it takes beside a matrix product.
    pub(super) work: u64,
}

impl WithSimd for Block<'_> {
    type Output = Searched;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Searched {
        let tree = &self.join.tree;
        let mut progress = self.begin(simd);
        let mut reach = self.visit(simd, self.leaf, &mut progress);
        let mut open = BinaryHeap::new();
        open.push((Reverse(0), Reverse(0)));
        while let Some((Reverse(bound), Reverse(node))) = open.pop() {
            if f32::from_bits(bound) > reach {
                break;
            }
            match tree.below(node) {
                Below::Leaf(leaf) if leaf == self.leaf => {}
                Below::Leaf(leaf) => reach = self.visit(simd, leaf, &mut progress),
                Below::Nodes(children) => {
                    let bounds = (&progress.bounds.0[..], &progress.bounds.1[..]);
                    for child in children {
                        let bound = box_to_box(simd, bounds, tree.bounds(child));
                        if bound <= reach {
                            // Bits of floats that are not negative are ordered as the floats.
                            open.push((Reverse(bound.to_bits()), Reverse(child)));
                        }
                    }
                }
            }
        }
        let (pool, columns) = (self.join.pool(), self.join.sources.columns() as u64);
        let looked: u64 = progress.one.iter().map(|one| one.pending.looked()).sum();
        let work = progress.work + looked * STATE_COST * columns;
        let finish = |one: One<'_>| one.pending.finish(pool, self.queries);
        Searched { lists: progress.one.into_iter().map(finish).collect(), work }
    }
}

impl<'a> Block<'a> {
    /// The queries with their images and first radii.
    #[inline(always)]
    fn begin<S: Simd>(&self, simd: S) -> Progress<'a> {
        let width = self.join.embedding.width();
        let mut progress = Progress {
            one: Vec::with_capacity(self.order.len()),
            images: vec![0.0; self.order.len() * width],
            lanes: vec![0.0; QUERIES * width],
            bounds: (vec![f32::INFINITY; width], vec![f32::NEG_INFINITY; width]),
            thresholds: [-1.0; QUERIES],
            work: 0,
        };
        for (lane, &query) in self.order.iter().enumerate() {
            let image = &mut progress.images[lane * width..][..width];
            let norm = self.join.image(self.queries, query as usize, image);
            let slack = self.join.embedding.slack(self.join.norm, norm);
            let (pool, query) = (self.join.pool(), query as usize);
            let one = One { pending: Pending::new(simd, pool, self.queries, query, self.k), slack };
            progress.thresholds[lane] = self.threshold(&one);
            for (c, &value) in image.iter().enumerate() {
                progress.lanes[c * QUERIES + lane] = value;
                progress.bounds.0[c] = progress.bounds.0[c].min(value);
                progress.bounds.1[c] = progress.bounds.1[c].max(value);
            }
            progress.one.push(one);
        }
        progress
    }

    /// Images beyond this squared distance from the query's need not be looked at.
    fn threshold(&self, one: &One<'_>) -> f32 {
        one.pending.radius().map_or(-1.0, |radius| {
            let reach = radius.sqrt() + one.slack;
            self.join.image_margin.threshold(reach * reach)
        })
    }

    /// Meet every source of a leaf that could be near enough to some query. Returns the largest threshold.
    #[inline(always)]
    fn visit<S: Simd>(&self, simd: S, leaf: usize, progress: &mut Progress<'_>) -> f32 {
        let (tree, width) = (&self.join.tree, self.join.embedding.width());
        let Progress { one, images, lanes, thresholds, work, .. } = progress;
        *work += (BOX_COST * QUERIES * width) as u64;
        let mut to_box = [0.0; QUERIES];
        let bounds = tree.bounds(tree.node_of(leaf));
        if box_to_lanes(simd, bounds, lanes, thresholds, &mut to_box) {
            let mut distances = [0.0; LEAF];
            let lanes = tree.lanes(leaf);
            for (lane, one) in one.iter_mut().enumerate() {
                let threshold = &mut thresholds[lane];
                if to_box[lane] > *threshold {
                    continue;
                }
                *work += (LEAF_COST * LEAF * width) as u64;
                let image = &images[lane * width..][..width];
                let least = lane_distances(simd, image, lanes, *threshold, &mut distances);
                if least <= *threshold {
                    self.meet(simd, leaf, &distances, one, threshold);
                }
            }
        }
        thresholds.iter().copied().fold(-1.0, f32::max)
    }

    /// Meet the sources of a leaf whose images are near enough to one query.
    #[inline(always)]
    fn meet<S: Simd>(
        &self,
        simd: S,
        leaf: usize,
        distances: &[f32; LEAF],
        one: &mut One<'_>,
        threshold: &mut f32,
    ) {
        for (&group, &distance) in self.join.tree.images(leaf).iter().zip(distances) {
            if distance <= *threshold && one.pending.meet(simd, self.join.pool(), group) {
                *threshold = self.threshold(one);
            }
        }
    }
}
