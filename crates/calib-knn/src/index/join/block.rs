//! The search of one block of queries that lie near each other.

#![expect(
    clippy::inline_always,
    reason = "inner loops must take the instruction set of the function that calls them"
)]

use std::{cmp::Reverse, collections::BinaryHeap, ops::Range};

use pulp::{Simd, WithSimd};

use super::{
    Join,
    kernel::{box_to_box, lane_distances, state_distance},
    tree::{Below, LEAF},
};
use crate::{
    MemberLists,
    distance::{Margin, squared},
    index::Queries,
    lists::Candidate,
};

/// A block of queries of one leaf.
pub(super) struct Block<'a> {
    pub(super) join: &'a Join<'a>,
    pub(super) queries: &'a Queries<'a>,
    /// The queries.
    pub(super) numbers: &'a [u32],
    /// The leaf that they lie in.
    pub(super) leaf: usize,
    pub(super) k: usize,
}

/// What is known about one query while leaves are visited.
struct Progress<'a> {
    state: &'a [f32],
    forbidden: Range<u32>,
    lists: MemberLists,
    /// An upper bound on the final radius, from neighbours in time.
    cap: f64,
    /// By how much images may be further apart than states.
    slack: f64,
    /// Images beyond this squared distance need not be looked at.
    threshold: f32,
    /// States beyond this squared distance, as f32 sums, need not be looked at.
    state_threshold: f32,
}

impl Progress<'_> {
    fn update(&mut self, images: Margin, states: Margin) {
        let radius = self.cap.min(self.lists.radius());
        if radius < 0.0 {
            // No member wants this query.
            (self.threshold, self.state_threshold) = (-1.0, -1.0);
            return;
        }
        let reach = radius.sqrt() + self.slack;
        self.threshold = images.threshold(reach * reach);
        self.state_threshold = states.threshold(radius);
    }
}

impl WithSimd for Block<'_> {
    type Output = Vec<MemberLists>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<MemberLists> {
        let tree = &self.join.tree;
        let width = self.join.embedding.width();
        let images_margin = Margin::new(width);
        let states_margin = Margin::new(self.join.sources.columns());
        let mut images = vec![0.0; self.numbers.len() * width];
        let mut bounds = (vec![f32::INFINITY; width], vec![f32::NEG_INFINITY; width]);
        let mut progress: Vec<Progress<'_>> = Vec::with_capacity(self.numbers.len());
        for (&query, image) in self.numbers.iter().zip(images.chunks_exact_mut(width)) {
            let mut one = self.progress(query as usize, image);
            for (c, &value) in image.iter().enumerate() {
                bounds.0[c] = bounds.0[c].min(value);
                bounds.1[c] = bounds.1[c].max(value);
            }
            one.update(images_margin, states_margin);
            progress.push(one);
        }
        let bounds = (&bounds.0[..], &bounds.1[..]);
        let mut reach = self.visit(simd, self.leaf, &images, &mut progress);
        let mut open = BinaryHeap::new();
        open.push((Reverse(0), Reverse(0)));
        while let Some((Reverse(bound), Reverse(node))) = open.pop() {
            if f32::from_bits(bound) > reach {
                break;
            }
            match tree.below(node) {
                Below::Leaf(leaf) if leaf == self.leaf => {}
                Below::Leaf(leaf) => reach = self.visit(simd, leaf, &images, &mut progress),
                Below::Nodes(children) => {
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
        progress.into_iter().map(|one| one.lists).collect()
    }
}

impl<'a> Block<'a> {
    /// A query with its image and its first radius.
    #[inline(always)]
    fn progress(&self, query: usize, image: &mut [f32]) -> Progress<'a> {
        let join = self.join;
        let blocks = join.sources.blocks();
        let state = self.queries.states().row(self.queries.row(query));
        let norm = join.embedding.map(state, image);
        let mut lists = MemberLists::new(blocks.members(), self.k);
        let forbidden = self.queries.forbidden(query);
        lists.reset(self.queries.wanted(query));
        for transition in self.queries.near_in_time(query, self.k + 2) {
            let squared = squared(state, join.sources.state(transition));
            lists.offer(Candidate { squared, transition }, blocks);
        }
        let cap = lists.radius();
        lists.reset(self.queries.wanted(query));
        let slack = join.embedding.slack(join.norm, norm);
        let (threshold, state_threshold) = (f32::INFINITY, f32::INFINITY);
        Progress { state, forbidden, lists, cap, slack, threshold, state_threshold }
    }

    /// Meet every source of a leaf that could be near enough to some query. Returns the largest threshold.
    #[inline(always)]
    fn visit<S: Simd>(
        &self,
        simd: S,
        leaf: usize,
        images: &[f32],
        progress: &mut [Progress<'_>],
    ) -> f32 {
        let (tree, width) = (&self.join.tree, self.join.embedding.width());
        let mut distances = [0.0; LEAF];
        let mut reach = -1.0_f32;
        let below = tree.bounds(tree.node_of(leaf));
        let lanes = tree.lanes(leaf);
        for (one, image) in progress.iter_mut().zip(images.chunks_exact(width)) {
            if box_to_box(simd, (image, image), below) <= one.threshold {
                let least = lane_distances(simd, image, lanes, one.threshold, &mut distances);
                if least <= one.threshold {
                    self.survivors(simd, one, leaf, &distances);
                }
            }
            reach = reach.max(one.threshold);
        }
        reach
    }

    /// Meet the sources of a leaf whose images are near enough.
    #[inline(always)]
    fn survivors<S: Simd>(
        &self,
        simd: S,
        one: &mut Progress<'_>,
        leaf: usize,
        distances: &[f32; LEAF],
    ) {
        let images = Margin::new(self.join.embedding.width());
        let states = Margin::new(self.join.sources.columns());
        for (&group, &distance) in self.join.tree.images(leaf).iter().zip(distances) {
            if distance <= one.threshold {
                self.meet(simd, one, group as usize, images, states);
            }
        }
    }

    /// A source whose image is near enough.
    #[inline(always)]
    fn meet<S: Simd>(
        &self,
        simd: S,
        one: &mut Progress<'_>,
        group: usize,
        images: Margin,
        states: Margin,
    ) {
        let (sources, groups) = (&self.join.sources, &self.join.groups);
        let transitions = groups.transitions(group);
        if transitions.iter().all(|transition| one.forbidden.contains(transition)) {
            return;
        }
        let source = sources.state(transitions[0]);
        if state_distance(simd, one.state, source) > one.state_threshold {
            return;
        }
        let before = one.lists.radius();
        let squared = squared(one.state, source);
        groups.offer(group, squared, &one.forbidden, &mut one.lists, sources);
        if one.lists.radius() < before {
            one.update(images, states);
        }
    }
}
