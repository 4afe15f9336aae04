//! The search of blocks of nearby queries.

#![expect(
    clippy::inline_always,
    reason = "inner loops must take the instruction set of the function that calls them"
)]

use std::{cmp::Reverse, collections::BinaryHeap, marker::PhantomData, ops::RangeInclusive};

use calib_core::Monitor;
use pulp::{Simd, WithSimd};

use super::{
    class_masks::Mask,
    far::apart,
    kernel::{
        box_to_box, box_to_lanes, image_to_boxes, least, nearest_first, strip_distances, within,
    },
    structure::Join,
    tree::{Below, SIDES, STRIP, STRIPS},
};
use crate::{
    Lists,
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
pub(super) struct Band<'a, L> {
    pub(super) join: &'a Join<'a>,
    pub(super) queries: &'a Queries<'a>,
    /// The leaf and the queries of each block, at most [`QUERIES`] each.
    pub(super) blocks: &'a [(usize, &'a [u32])],
    pub(super) k: usize,
    pub(super) limit: Limit,
    pub(super) monitor: &'a dyn Monitor,
    pub(super) lists: PhantomData<L>,
}

impl<L> Copy for Band<'_, L> {}

impl<L> Clone for Band<'_, L> {
    fn clone(&self) -> Self {
        *self
    }
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
struct Block<'a, L> {
    /// The leaf that the queries lie in.
    leaf: usize,
    one: Vec<One<'a, L>>,
    /// Images, `[query, coordinate]`.
    images: Vec<f32>,
    /// Images, `[coordinate, query]`.
    lanes: Vec<f32>,
    /// The bounding box of the images.
    bounds: Bounds,
    thresholds: Thresholds,
    /// The largest threshold of each class.
    reach: Vec<f32>,
    /// Work on boxes and images so far; see [`Searched`].
    work: u64,
}

/// Squared distances per class and query beyond which images need not be looked at. Negative past the last query.
struct Thresholds(Vec<[f32; QUERIES]>);

impl Thresholds {
    /// Returns the largest thresholds of all queries for sources that are of these classes, if there are any.
    #[inline(always)]
    fn of_all(&self, classes: Option<Mask>) -> [f32; QUERIES] {
        let Some(classes) = classes else { return self.0[0] };
        let mut most = [-1.0; QUERIES];
        for thresholds in classes.own(&self.0) {
            for (most, &threshold) in most.iter_mut().zip(thresholds) {
                *most = f32::max(*most, threshold);
            }
        }
        most
    }

    /// Returns the largest threshold of a query for sources that are of these classes, if there are any.
    #[inline(always)]
    fn of_query(&self, lane: usize, classes: Option<Mask>) -> f32 {
        classes.map_or(self.0[0][lane], |classes| {
            classes.most(self.0.iter().map(|thresholds| thresholds[lane]))
        })
    }
}

/// The state of one query's search.
struct One<'a, L> {
    pending: Pending<'a, L>,
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
pub(super) struct Searched<L> {
    pub(super) lists: Vec<L>,
    /// Work in multiply-adds. Each kind of work counts by its time relative to a matrix product.
    pub(super) work: u64,
}

impl<L: Lists> WithSimd for Band<'_, L> {
    type Output = Searched<L>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Searched<L> {
        let tree = &self.join.tree;
        let mut around = Bounds::nothing(self.join.embedding.width());
        let mut blocks: Vec<Block<'_, L>> = Vec::with_capacity(self.blocks.len());
        for &(leaf, order) in self.blocks {
            let mut block = self.begin(simd, leaf, order);
            self.visit(simd, leaf, &mut block);
            around.include(&block.bounds.lower, &block.bounds.upper);
            blocks.push(block);
        }
        let mut reach = vec![-1.0; self.classes()];
        farthest_reach(&blocks, &mut reach);
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
            let bound = f32::from_bits(bound);
            if bound > reach.iter().copied().fold(-1.0, f32::max) || given_up {
                break;
            }
            if L::BY_CLASS && bound > self.reach(&reach, node) {
                continue;
            }
            match tree.below(node) {
                Below::Leaf(leaf) => {
                    for block in blocks.iter_mut().filter(|block| block.leaf != leaf) {
                        let bound = box_to_box(simd, block.bounds.sides(), tree.bounds(node));
                        if bound <= self.reach(&block.reach, node) {
                            self.visit(simd, leaf, block);
                        }
                    }
                    farthest_reach(&blocks, &mut reach);
                    let own = blocks.iter().any(|block| block.leaf == leaf);
                    left = left.saturating_sub(usize::from(!own));
                }
                Below::Nodes(children) => {
                    for child in children {
                        let bound = box_to_box(simd, around.sides(), tree.bounds(child));
                        if bound <= self.reach(&reach, child) {
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

/// Sets the largest threshold of each class over all blocks.
fn farthest_reach<L>(blocks: &[Block<'_, L>], reach: &mut [f32]) {
    reach.fill(-1.0);
    for block in blocks {
        for (most, &own) in reach.iter_mut().zip(&block.reach) {
            *most = most.max(own);
        }
    }
}

/// Whether every query of the blocks has full lists.
fn are_full<L: Lists>(blocks: &[Block<'_, L>]) -> bool {
    blocks.iter().flat_map(|block| &block.one).all(|one| one.pending.is_full())
}

impl<'a, L: Lists> Band<'a, L> {
    /// Returns the number of classes for which there are lists.
    fn classes(&self) -> usize {
        if L::BY_CLASS { self.queries.classes().count() } else { 1 }
    }

    /// Returns the largest of the thresholds, one per class, for the sources below a node.
    #[inline(always)]
    fn reach(&self, reach: &[f32], node: usize) -> f32 {
        if L::BY_CLASS { self.join.masks.node(node).most(reach.iter().copied()) } else { reach[0] }
    }

    fn work(&self, blocks: &[Block<'_, L>]) -> u64 {
        let ones = blocks.iter().flat_map(|block| &block.one);
        let looked: u64 = ones.map(|one| one.pending.looked()).sum();
        let states = looked * STATE_COST * self.join.sources.columns() as u64;
        states + blocks.iter().map(|block| block.work).sum::<u64>()
    }

    /// Starts a block: computes the images and first radii of its queries.
    #[inline(always)]
    fn begin<S: Simd>(&self, simd: S, leaf: usize, order: &[u32]) -> Block<'a, L> {
        let width = self.join.embedding.width();
        let mut block = Block {
            leaf,
            one: Vec::with_capacity(order.len()),
            images: vec![0.0; order.len() * width],
            lanes: vec![0.0; QUERIES * width],
            bounds: Bounds::nothing(width),
            thresholds: Thresholds(vec![[-1.0; QUERIES]; self.classes()]),
            reach: vec![-1.0; self.classes()],
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
            for (class, thresholds) in block.thresholds.0.iter_mut().enumerate() {
                thresholds[lane] = self.threshold(&one, class);
            }
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
    fn meet_far<S: Simd>(&self, simd: S, one: &mut One<'_, L>) {
        if let Some(radius) = one.pending.radius() {
            for group in self.join.far.within(one.norm.clone(), radius.sqrt()) {
                let pool = self.join.pool();
                one.pending.meet(simd, pool, group, pool.class(group));
            }
        }
    }

    /// Returns the squared distance beyond which images of a class need not be looked at.
    fn threshold(&self, one: &One<'_, L>, class: usize) -> f32 {
        // A query far from the mean that has found neighbours there needs nothing from the tree.
        let radius = (one.pending.radius_in(class))
            .filter(|radius| !apart(*one.norm.start(), self.join.norm, radius.sqrt()));
        radius.map_or(-1.0, |radius| {
            let reach = radius.sqrt() + one.slack;
            self.join.image_margin.threshold(reach * reach)
        })
    }

    /// Compares each query of the block with every source of a leaf that could be near enough.
    #[inline(always)]
    fn visit<S: Simd>(&self, simd: S, leaf: usize, block: &mut Block<'_, L>) {
        let tree = &self.join.tree;
        let width = self.join.embedding.width();
        let Block { leaf: home, one, images, lanes, thresholds, work, .. } = block;
        *work += (BOX_COST * QUERIES * width) as u64;
        let mut to_box = [0.0; QUERIES];
        let node = tree.node_of(leaf);
        let masks = &self.join.masks;
        let limits = thresholds.of_all(L::BY_CLASS.then(|| masks.node(node)));
        // The other coordinates are zero.
        let used = self.join.embedding.used();
        let (lower, upper) = tree.bounds(node);
        if box_to_lanes(simd, (&lower[..used], &upper[..used]), lanes, &limits, &mut to_box) {
            let boxes = tree.strip_boxes(leaf);
            for lane in within(&to_box, &limits) {
                let one = &mut one[lane];
                let image = &images[lane * width..][..used];
                let mut to_strips = [0.0; STRIPS];
                image_to_boxes(simd, image, boxes, &mut to_strips);
                let strips = within(&to_strips, &[limits[lane]; STRIPS]);
                *work +=
                    (BOX_COST * STRIPS * SIDES + LEAF_COST * STRIP * strips.len() * width) as u64;
                // In its own leaf, a query begins with the nearest strip. Its radius shrinks early, so fewer sources are
                // compared. For lists of several classes, one strip is not enough. A closure would not take the instruction
                // set.
                if L::BY_CLASS && leaf == *home {
                    for strip in nearest_first(&to_strips) {
                        let part = Part { leaf, strip, distance: to_strips[strip] };
                        self.visit_part(simd, part, image, one, lane, thresholds);
                    }
                } else {
                    let nearest = if leaf == *home { least(&to_strips) } else { 0 };
                    for strip in strips.beginning_with(nearest) {
                        let part = Part { leaf, strip, distance: to_strips[strip] };
                        self.visit_part(simd, part, image, one, lane, thresholds);
                    }
                }
            }
        }
        for (reach, thresholds) in block.reach.iter_mut().zip(&thresholds.0) {
            *reach = thresholds.iter().copied().fold(-1.0, f32::max);
        }
    }

    /// Compares a query with every source of a strip that could be near enough.
    #[inline(always)]
    fn visit_part<S: Simd>(
        &self,
        simd: S,
        part: Part,
        image: &[f32],
        one: &mut One<'_, L>,
        lane: usize,
        thresholds: &mut Thresholds,
    ) {
        let Part { leaf, strip, distance } = part;
        let Join { tree, masks, .. } = self.join;
        let limit = thresholds.of_query(lane, L::BY_CLASS.then(|| masks.strip(leaf, strip)));
        let mut distances = [0.0; STRIP];
        if distance > limit
            || !strip_distances(simd, image, tree.strip(leaf, strip), limit, &mut distances)
        {
            return;
        }
        let places = tree.places(leaf);
        for place in within(&distances, &[limit; STRIP]) {
            let group = places.start + (strip * STRIP + place) as u32;
            // Lanes past the last image are unused.
            if group >= places.end {
                break;
            }
            let class = if L::BY_CLASS { masks.class(group) } else { 0 };
            let threshold = &mut thresholds.0[class][lane];
            if distances[place] <= *threshold
                && one.pending.meet(simd, self.join.pool(), group, class)
            {
                *threshold = self.threshold(one, class);
            }
        }
    }
}

/// A strip of a leaf, and the squared distance of a query's image from its box.
#[derive(Clone, Copy)]
struct Part {
    leaf: usize,
    strip: usize,
    distance: f32,
}
