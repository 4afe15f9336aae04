//! The search of one block of queries that lie near each other.

#![expect(
    clippy::inline_always,
    reason = "inner loops must take the instruction set of the function that calls them"
)]

use std::{cmp::Reverse, collections::BinaryHeap, ops::Range};

use pulp::{Simd, WithSimd};

use super::{
    Join,
    kernel::{box_to_box, box_to_lanes, lane_distances, state_distance},
    tree::{Below, LEAF},
};
use crate::{
    MemberLists,
    distance::squared_of_four,
    index::Queries,
    lists::Candidate,
};

/// Most queries of a block.
pub(super) const QUERIES: usize = 64;

/// A block of queries of one leaf.
pub(super) struct Block<'a> {
    pub(super) join: &'a Join<'a>,
    pub(super) queries: &'a Queries<'a>,
    /// The queries, at most [`QUERIES`].
    pub(super) numbers: &'a [u32],
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
}

/// What is known about one query.
struct One<'a> {
    state: &'a [f32],
    forbidden: Range<u32>,
    /// Lists of upper bounds of distances; their radius is an upper bound of the final one.
    lists: MemberLists,
    /// Another upper bound, from neighbours in time.
    cap: f64,
    /// By how much images may be further apart than states.
    slack: f64,
    /// States beyond this squared distance, as f32 sums, need not be looked at.
    state_threshold: f32,
    /// Groups that could be near enough, with their squared distances as f32 sums.
    met: Vec<(f32, u32)>,
}

impl WithSimd for Block<'_> {
    type Output = Vec<MemberLists>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<MemberLists> {
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
        let numbers = self.numbers.iter().zip(progress.one);
        numbers.map(|(&query, one)| self.finish(query as usize, one)).collect()
    }
}

impl<'a> Block<'a> {
    /// The queries with their images and first radii.
    #[inline(always)]
    fn begin<S: Simd>(&self, simd: S) -> Progress<'a> {
        let width = self.join.embedding.width();
        let mut progress = Progress {
            one: Vec::with_capacity(self.numbers.len()),
            images: vec![0.0; self.numbers.len() * width],
            lanes: vec![0.0; QUERIES * width],
            bounds: (vec![f32::INFINITY; width], vec![f32::NEG_INFINITY; width]),
            thresholds: [-1.0; QUERIES],
        };
        for (lane, &query) in self.numbers.iter().enumerate() {
            let image = &mut progress.images[lane * width..][..width];
            let one = self.begin_one(simd, query as usize, image);
            for (c, &value) in image.iter().enumerate() {
                progress.lanes[c * QUERIES + lane] = value;
                progress.bounds.0[c] = progress.bounds.0[c].min(value);
                progress.bounds.1[c] = progress.bounds.1[c].max(value);
            }
            progress.one.push(one);
            self.narrow(&mut progress.one[lane], &mut progress.thresholds[lane]);
        }
        progress
    }

    #[inline(always)]
    fn begin_one<S: Simd>(&self, simd: S, query: usize, image: &mut [f32]) -> One<'a> {
        let join = self.join;
        let blocks = join.sources.blocks();
        let state = self.queries.states().row(self.queries.row(query));
        let norm = join.image(self.queries, query, image);
        let mut lists = MemberLists::new(blocks.members(), self.k);
        lists.reset(self.queries.wanted(query));
        for transition in self.queries.near_in_time(query, self.k + 2) {
            let distance = state_distance(simd, state, join.sources.state(transition));
            let squared = join.state_margin.upper(distance);
            lists.offer(Candidate { squared, transition }, blocks);
        }
        let cap = lists.radius();
        lists.reset(self.queries.wanted(query));
        One {
            state,
            forbidden: self.queries.forbidden(query),
            lists,
            cap,
            slack: join.embedding.slack(join.norm, norm),
            state_threshold: f32::INFINITY,
            met: Vec::with_capacity(4 * self.k),
        }
    }

    /// Take what is known now into the thresholds.
    #[inline(always)]
    fn narrow(&self, one: &mut One<'_>, threshold: &mut f32) {
        let radius = one.cap.min(one.lists.radius());
        if radius < 0.0 {
            // No member wants this query.
            (*threshold, one.state_threshold) = (-1.0, -1.0);
            return;
        }
        let reach = radius.sqrt() + one.slack;
        *threshold = self.join.image_margin.threshold(reach * reach);
        one.state_threshold = self.join.state_margin.threshold(radius);
    }

    /// Meet every source of a leaf that could be near enough to some query. Returns the largest threshold.
    #[inline(always)]
    fn visit<S: Simd>(&self, simd: S, leaf: usize, progress: &mut Progress<'_>) -> f32 {
        let (tree, width) = (&self.join.tree, self.join.embedding.width());
        let Progress { one, images, lanes, thresholds, .. } = progress;
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
        let (sources, groups) = (&self.join.sources, &self.join.groups);
        for (&group, &distance) in self.join.tree.images(leaf).iter().zip(distances) {
            if distance > *threshold {
                continue;
            }
            let transitions = groups.transitions(group as usize);
            if transitions.iter().all(|transition| one.forbidden.contains(transition)) {
                continue;
            }
            let distance = state_distance(simd, one.state, sources.state(transitions[0]));
            if distance > one.state_threshold {
                continue;
            }
            one.met.push((distance, group));
            let before = one.lists.radius();
            let squared = self.join.state_margin.upper(distance);
            groups.offer(group as usize, squared, &one.forbidden, &mut one.lists, sources);
            if one.lists.radius() < before {
                self.narrow(one, threshold);
            }
        }
    }

    /// The lists by the definition, from the groups that can be in them.
    fn finish(&self, query: usize, mut one: One<'_>) -> MemberLists {
        let (sources, groups) = (&self.join.sources, &self.join.groups);
        one.lists.reset(self.queries.wanted(query));
        one.met.retain(|&(distance, _)| distance <= one.state_threshold);
        let state = |group: u32| sources.state(groups.first(group as usize));
        for four in one.met.chunks(4) {
            let group = |i: usize| four[i.min(four.len() - 1)].1;
            let states = [0, 1, 2, 3].map(|i| state(group(i)));
            for (&(_, group), squared) in four.iter().zip(squared_of_four(one.state, states)) {
                groups.offer(group as usize, squared, &one.forbidden, &mut one.lists, sources);
            }
        }
        one.lists
    }
}
