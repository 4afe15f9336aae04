//! The search of blocks of nearby queries.

#![expect(
    clippy::inline_always,
    reason = "inner loops must take the instruction set of the function that calls them"
)]

use std::{cmp::Reverse, collections::BinaryHeap, ops::RangeInclusive};

use calib_core::Monitor;
use pulp::{Simd, WithSimd};

use super::{
    Join,
    far::apart,
    kernel::{box_to_box, box_to_lanes, image_to_boxes, least, strip_distances, within},
    tree::{Below, SIDES, STRIP, STRIPS},
};
use crate::{
    MemberLists,
    index::{Queries, pending::Pending},
};

/// Maximum number of queries in a block.
pub(super) const QUERIES: usize = 64;

// Cost of one coordinate relative to a multiply-add in a matrix product: rough values that were measured once. A state is
// read from anywhere in memory.
const BOX_COST: usize = 8;
const LEAF_COST: usize = 2;
const STATE_COST: u64 = 32;

/// Nodes between two checks for an interruption.
const LOOK: usize = 256;

/// Blocks of queries from neighbouring leaves. They mostly visit the same leaves, so each leaf is loaded into the cache
/// once for all.
#[derive(Clone, Copy)]
pub(super) struct Band<'a> {
    pub(super) join: &'a Join<'a>,
    pub(super) queries: &'a Queries<'a>,
    /// The leaf and the queries of each block, at most [`QUERIES`] each.
    pub(super) blocks: &'a [(usize, &'a [u32])],
    pub(super) k: usize,
    pub(super) limit: Limit,
    pub(super) monitor: &'a dyn Monitor,
}

/// Limits that can end a search before it is exact.
#[derive(Clone, Copy)]
pub(super) struct Limit {
    /// Work after which an estimate of the work stops.
    pub(super) work: u64,
    /// Maximum number of leaves that are visited besides those of the queries.
    pub(super) leaves: usize,
}

/// The state of a block's search while leaves are visited.
struct Block<'a> {
    /// The leaf that the queries lie in.
    leaf: usize,
    one: Vec<One<'a>>,
    /// Images, `[query, coordinate]`.
    images: Vec<f32>,
    /// Images, `[coordinate, query]`.
    lanes: Vec<f32>,
    /// The bounding box of the images.
    bounds: Bounds,
    /// Squared distance per query beyond which images need not be looked at. Negative past the last query.
    thresholds: [f32; QUERIES],
    /// The largest threshold.
    reach: f32,
    /// Work on boxes and images so far; see [`Searched`].
    work: u64,
}

/// The state of one query's search.
struct One<'a> {
    pending: Pending<'a>,
    /// Maximum by which the distance of two images may exceed that of their states.
    slack: f64,
    /// Bounds on the query's distance from the mean.
    norm: RangeInclusive<f64>,
}

/// The lower and upper bounds of a box.
struct Bounds {
    lower: Vec<f32>,
    upper: Vec<f32>,
}

impl Bounds {
    fn nothing(width: usize) -> Self {
        Self { lower: vec![f32::INFINITY; width], upper: vec![f32::NEG_INFINITY; width] }
    }

    fn include(&mut self, lower: &[f32], upper: &[f32]) {
        for (side, &value) in self.lower.iter_mut().zip(lower) {
            *side = side.min(value);
        }
        for (side, &value) in self.upper.iter_mut().zip(upper) {
            *side = side.max(value);
        }
    }

    fn sides(&self) -> (&[f32], &[f32]) {
        (&self.lower, &self.upper)
    }
}

/// The lists of a band, in the order of its queries, and the work that they took.
pub(super) struct Searched {
    pub(super) lists: Vec<MemberLists>,
    /// Work in multiply-adds. Each kind of work counts by its time relative to a matrix product.
    pub(super) work: u64,
}

impl WithSimd for Band<'_> {
    type Output = Searched;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Searched {
        let tree = &self.join.tree;
        let mut around = Bounds::nothing(self.join.embedding.width());
        let mut blocks: Vec<Block<'_>> = Vec::with_capacity(self.blocks.len());
        for &(leaf, order) in self.blocks {
            let mut block = self.begin(simd, leaf, order);
            self.visit(simd, leaf, &mut block);
            around.include(&block.bounds.lower, &block.bounds.upper);
            blocks.push(block);
        }
        let mut reach = farthest_reach(&blocks);
        let mut left = self.limit.leaves;
        let mut open = BinaryHeap::new();
        let mut popped = 0_usize;
        open.push((Reverse(0), Reverse(0)));
        // Where no source can be ruled out, a band takes long. Its lists are unused once it is interrupted.
        while let Some((Reverse(bound), Reverse(node))) = open.pop() {
            popped += 1;
            if popped.is_multiple_of(LOOK) && self.monitor.interrupted() {
                break;
            }
            // Even a search that ends early must fill its lists.
            let given_up = (left == 0 && are_full(&blocks))
                || (self.limit.work < u64::MAX && self.work(&blocks) > self.limit.work);
            if f32::from_bits(bound) > reach || given_up {
                break;
            }
            match tree.below(node) {
                Below::Leaf(leaf) => {
                    for block in blocks.iter_mut().filter(|block| block.leaf != leaf) {
                        let bound = box_to_box(simd, block.bounds.sides(), tree.bounds(node));
                        if bound <= block.reach {
                            self.visit(simd, leaf, block);
                        }
                    }
                    reach = farthest_reach(&blocks);
                    let own = blocks.iter().any(|block| block.leaf == leaf);
                    left = left.saturating_sub(usize::from(!own));
                }
                Below::Nodes(children) => {
                    for child in children {
                        let bound = box_to_box(simd, around.sides(), tree.bounds(child));
                        if bound <= reach {
                            // The bits of non-negative floats have the same order as the floats.
                            open.push((Reverse(bound.to_bits()), Reverse(child)));
                        }
                    }
                }
            }
        }
        let ones = blocks.iter_mut().flat_map(|block| &mut block.one);
        for one in ones.filter(|one| *one.norm.start() <= self.join.norm) {
            self.meet_far(simd, one);
        }
        let pool = self.join.pool();
        let work = self.work(&blocks);
        let ones = blocks.into_iter().flat_map(|block| block.one);
        let lists = ones.map(|one| one.pending.finish(pool)).collect();
        Searched { lists, work }
    }
}

fn farthest_reach(blocks: &[Block<'_>]) -> f32 {
    blocks.iter().map(|block| block.reach).fold(-1.0, f32::max)
}

/// Whether every query of the blocks has full lists.
fn are_full(blocks: &[Block<'_>]) -> bool {
    blocks.iter().flat_map(|block| &block.one).all(|one| one.pending.is_full())
}

impl<'a> Band<'a> {
    fn work(&self, blocks: &[Block<'_>]) -> u64 {
        let ones = blocks.iter().flat_map(|block| &block.one);
        let looked: u64 = ones.map(|one| one.pending.looked()).sum();
        let states = looked * STATE_COST * self.join.sources.columns() as u64;
        states + blocks.iter().map(|block| block.work).sum::<u64>()
    }

    /// Starts a block: computes the images and first radii of its queries.
    #[inline(always)]
    fn begin<S: Simd>(&self, simd: S, leaf: usize, order: &[u32]) -> Block<'a> {
        let width = self.join.embedding.width();
        let mut block = Block {
            leaf,
            one: Vec::with_capacity(order.len()),
            images: vec![0.0; order.len() * width],
            lanes: vec![0.0; QUERIES * width],
            bounds: Bounds::nothing(width),
            thresholds: [-1.0; QUERIES],
            reach: -1.0,
            work: 0,
        };
        for (lane, &query) in order.iter().enumerate() {
            let image = &mut block.images[lane * width..][..width];
            let norm = self.join.image(self.queries, query as usize, image);
            let slack = self.join.embedding.slack(self.join.norm, *norm.end());
            let pool = self.join.pool();
            let query = query as usize;
            let pending = Pending::new(simd, pool, self.queries, query, self.k);
            let mut one = One { pending, slack, norm };
            if self.limit.leaves < usize::MAX {
                one.pending.forget_neighbours_in_time(pool.margin);
            }
            if *one.norm.start() > self.join.norm {
                self.meet_far(simd, &mut one);
            }
            block.thresholds[lane] = self.threshold(&one);
            for (c, &value) in image.iter().enumerate() {
                block.lanes[c * QUERIES + lane] = value;
            }
            block.bounds.include(image, image);
            block.one.push(one);
        }
        block
    }

    /// Compares a query with the sources outside the tree that could be near enough.
    #[inline(always)]
    fn meet_far<S: Simd>(&self, simd: S, one: &mut One<'_>) {
        if let Some(radius) = one.pending.radius() {
            for group in self.join.far.within(one.norm.clone(), radius.sqrt()) {
                one.pending.meet(simd, self.join.pool(), group);
            }
        }
    }

    /// Returns the squared distance beyond which images need not be looked at.
    fn threshold(&self, one: &One<'_>) -> f32 {
        // A query far from the mean that has found neighbours there needs nothing from the tree.
        let radius = (one.pending.radius())
            .filter(|radius| !apart(*one.norm.start(), self.join.norm, radius.sqrt()));
        radius.map_or(-1.0, |radius| {
            let reach = radius.sqrt() + one.slack;
            self.join.image_margin.threshold(reach * reach)
        })
    }

    /// Compares each query of the block with every source of a leaf that could be near enough.
    #[inline(always)]
    fn visit<S: Simd>(&self, simd: S, leaf: usize, block: &mut Block<'_>) {
        let tree = &self.join.tree;
        let width = self.join.embedding.width();
        let Block { leaf: home, one, images, lanes, thresholds, work, .. } = block;
        *work += (BOX_COST * QUERIES * width) as u64;
        let mut to_box = [0.0; QUERIES];
        let bounds = tree.bounds(tree.node_of(leaf));
        if box_to_lanes(simd, bounds, lanes, thresholds, &mut to_box) {
            let boxes = tree.strip_boxes(leaf);
            for lane in within(&to_box, thresholds) {
                let one = &mut one[lane];
                let threshold = &mut thresholds[lane];
                let image = &images[lane * width..][..width];
                let mut to_strips = [0.0; STRIPS];
                image_to_boxes(simd, image, boxes, &mut to_strips);
                let strips = within(&to_strips, &[*threshold; STRIPS]);
                *work +=
                    (BOX_COST * STRIPS * SIDES + LEAF_COST * STRIP * strips.len() * width) as u64;
                // In its own leaf, a query begins with the nearest strip. Its radius shrinks early, so fewer sources are
                // compared.
                let nearest = if leaf == *home { least(&to_strips) } else { 0 };
                for strip in strips.beginning_with(nearest) {
                    if to_strips[strip] > *threshold {
                        continue;
                    }
                    let mut distances = [0.0; STRIP];
                    let lanes = tree.strip(leaf, strip);
                    if strip_distances(simd, image, lanes, *threshold, &mut distances) {
                        self.meet(simd, leaf, strip, &distances, one, threshold);
                    }
                }
            }
        }
        block.reach = thresholds.iter().copied().fold(-1.0, f32::max);
    }

    /// Compares a query with the sources of a strip whose images are near enough.
    #[inline(always)]
    fn meet<S: Simd>(
        &self,
        simd: S,
        leaf: usize,
        strip: usize,
        distances: &[f32; STRIP],
        one: &mut One<'_>,
        threshold: &mut f32,
    ) {
        for (group, &distance) in self.join.tree.places(leaf).skip(strip * STRIP).zip(distances) {
            if distance <= *threshold && one.pending.meet(simd, self.join.pool(), group) {
                *threshold = self.threshold(one);
            }
        }
    }
}
