#![expect(
    clippy::inline_always,
    reason = "inner loops must take the instruction set of the function that calls them"
)]

use std::ops::Range;

use pulp::Simd;

use super::{Queries, Sources};
use crate::{
    MemberLists,
    distance::{Margin, squared_of_four},
    groups::Groups,
    lists::Candidate,
};

/// What is known about one query while candidates are met in any order.
///
/// Candidates are judged by f32 sums; the lists hold upper bounds of the distances meanwhile. At the end those
/// that can be in a list, by the margin of the rounding, are computed by the definition.
#[derive(Debug)]
pub(super) struct Pending<'a> {
    query: usize,
    state: &'a [f32],
    forbidden: Range<u32>,
    /// Lists of upper bounds of squared distances: their radius bounds the final one.
    lists: MemberLists,
    /// Another upper bound, from neighbours in time.
    cap: f64,
    /// States beyond this squared distance, as f32 sums, need not be looked at.
    threshold: f32,
    /// Groups that could be near enough, with their squared distances as f32 sums.
    met: Vec<(f32, u32)>,
    /// States that were looked at.
    looked: u64,
}

/// Where candidates come from.
#[derive(Clone, Copy)]
pub(super) struct Pool<'a> {
    pub(super) sources: &'a Sources<'a>,
    pub(super) groups: &'a Groups,
    pub(super) margin: Margin,
}

impl<'a> Pool<'a> {
    /// The state of a group.
    #[inline(always)]
    pub(super) fn state(&self, group: u32) -> &'a [f32] {
        self.sources.states().row(self.groups.row(group as usize))
    }
}

impl<'a> Pending<'a> {
    /// A query that has met its neighbours in time.
    #[inline(always)]
    pub(super) fn new<S: Simd>(
        simd: S,
        pool: Pool<'_>,
        queries: &Queries<'a>,
        query: usize,
        k: usize,
    ) -> Self {
        let blocks = pool.sources.blocks();
        let state = queries.states().row(queries.row(query));
        let mut lists = MemberLists::new(blocks.members(), k);
        lists.reset(queries.wanted(query));
        for transition in queries.near_in_time(query, k + 2) {
            let distance = state_distance(simd, state, pool.sources.state(transition));
            lists.offer(Candidate { squared: pool.margin.upper(distance), transition }, blocks);
        }
        let cap = lists.radius();
        lists.reset(queries.wanted(query));
        let forbidden = queries.forbidden(query);
        let met = Vec::with_capacity(4 * k);
        let mut this =
            Self { query, state, forbidden, lists, cap, threshold: -1.0, met, looked: 0 };
        this.narrow(pool.margin);
        this
    }

    fn narrow(&mut self, margin: Margin) {
        // No member wants a query of negative radius.
        self.threshold = self.radius().map_or(-1.0, |radius| margin.threshold(radius));
    }

    /// The state that is searched for.
    pub(super) fn state(&self) -> &'a [f32] {
        self.state
    }

    /// A bound on the squared distance of everything that can still enter a list; none if nothing can.
    pub(super) fn radius(&self) -> Option<f64> {
        let radius = self.cap.min(self.lists.radius());
        (radius >= 0.0).then_some(radius)
    }

    /// Do not count on neighbours in time to be met, as a search that ends early may not meet them.
    pub(super) fn forget_neighbours_in_time(&mut self, margin: Margin) {
        self.cap = f64::INFINITY;
        self.narrow(margin);
    }

    /// Whether every list has as many candidates as it can hold.
    pub(super) fn is_full(&self) -> bool {
        self.lists.radius() < f64::INFINITY
    }

    /// States that were looked at.
    pub(super) fn looked(&self) -> u64 {
        self.looked
    }

    /// Meet the sources of a group. Returns whether the radius has become smaller.
    #[inline(always)]
    pub(super) fn meet<S: Simd>(&mut self, simd: S, pool: Pool<'_>, group: u32) -> bool {
        let transitions = pool.groups.transitions(group as usize);
        if transitions.iter().all(|transition| self.forbidden.contains(transition)) {
            return false;
        }
        self.looked += 1;
        let distance = state_distance(simd, self.state, pool.state(group));
        if distance > self.threshold {
            return false;
        }
        self.met.push((distance, group));
        let before = self.lists.radius();
        let upper = pool.margin.upper(distance);
        pool.groups.offer(group as usize, upper, &self.forbidden, &mut self.lists, pool.sources);
        let nearer = self.lists.radius() < before;
        if nearer {
            self.narrow(pool.margin);
        }
        nearer
    }

    /// The lists by the definition, from the groups that can be in them.
    pub(super) fn finish(mut self, pool: Pool<'_>, queries: &Queries<'_>) -> MemberLists {
        self.lists.reset(queries.wanted(self.query));
        self.met.retain(|&(distance, _)| distance <= self.threshold);
        let state = |group: u32| pool.state(group);
        for four in self.met.chunks(4) {
            let states = [0, 1, 2, 3].map(|i: usize| state(four[i.min(four.len() - 1)].1));
            for (&(_, group), squared) in four.iter().zip(squared_of_four(self.state, states)) {
                let (forbidden, lists) = (&self.forbidden, &mut self.lists);
                pool.groups.offer(group as usize, squared, forbidden, lists, pool.sources);
            }
        }
        self.lists
    }
}

/// Squared distance of two states as an f32 sum.
#[inline(always)]
fn state_distance<S: Simd>(simd: S, a: &[f32], b: &[f32]) -> f32 {
    let ((a, a_tail), (b, b_tail)) = (S::as_simd_f32s(a), S::as_simd_f32s(b));
    let mut sums = [simd.splat_f32s(0.0); 4];
    let (a4, a_rest) = a.as_chunks::<4>();
    let (b4, b_rest) = b.as_chunks::<4>();
    for (a, b) in a4.iter().zip(b4) {
        for i in 0..4 {
            let difference = simd.sub_f32s(a[i], b[i]);
            sums[i] = simd.mul_add_e_f32s(difference, difference, sums[i]);
        }
    }
    for (&a, &b) in a_rest.iter().zip(b_rest) {
        let difference = simd.sub_f32s(a, b);
        sums[0] = simd.mul_add_e_f32s(difference, difference, sums[0]);
    }
    let (a, b) = (simd.partial_load_f32s(a_tail), simd.partial_load_f32s(b_tail));
    let difference = simd.sub_f32s(a, b);
    sums[1] = simd.mul_add_e_f32s(difference, difference, sums[1]);
    let sum = simd.add_f32s(simd.add_f32s(sums[0], sums[1]), simd.add_f32s(sums[2], sums[3]));
    simd.reduce_sum_f32s(sum)
}
