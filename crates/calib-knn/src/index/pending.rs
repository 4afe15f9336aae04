#![expect(
    clippy::inline_always,
    reason = "inner loops must take the instruction set of the function that calls them"
)]

use std::ops::Range;

use pulp::Simd;

use super::{Queries, Sources};
use crate::{
    Lists,
    candidate_mask::CandidateMask,
    distance::{Margin, squared, squared_of_four},
    groups::Groups,
    lists::Candidate,
};

/// Up to this many columns, lists of classes are filled by the definition at once. That is faster than an f32 sum before.
const FEW_COLUMNS: usize = 16;
/// Number of candidate groups that a query collects before it discards those that no longer count.
const MOST_MET: usize = 512;

/// The state of one query's search, which can receive candidates in any order.
///
/// Candidates are compared by f32 sums. Until the end, the lists hold upper bounds of the distances. At the end, the
/// candidates that can still be in a list, by the margin of the rounding, are measured by the definition.
#[derive(Debug)]
pub(super) struct Pending<'a, L> {
    state: &'a [f32],
    forbidden: Range<u32>,
    findable: CandidateMask<'a>,
    /// Lists of upper bounds of squared distances. Their radius bounds the final one.
    lists: L,
    /// Another upper bound, from neighbours in time.
    cap: f64,
    /// States beyond this squared distance, as an f32 sum, need not be looked at.
    threshold: f32,
    /// Groups that could be near enough, with their squared distances as f32 sums.
    met: Vec<(f32, u32)>,
    /// Number of collected groups at which those that cannot be in a list any more are discarded.
    most: usize,
    /// Number of states that were looked at.
    looked: u64,
}

/// The candidates' states, and how they are compared.
#[derive(Clone, Copy)]
pub(super) struct Pool<'a> {
    pub(super) sources: &'a Sources<'a>,
    pub(super) groups: &'a Groups,
    pub(super) margin: Margin,
}

impl<'a> Pool<'a> {
    #[inline(always)]
    pub(super) fn state(&self, group: u32) -> &'a [f32] {
        self.sources.states.row(self.groups.row(group as usize))
    }

    /// Whether distances are measured by the definition as soon as a group is met.
    #[inline(always)]
    fn measures_at_once<L: Lists>(&self) -> bool {
        L::BY_CLASS && self.sources.columns() <= FEW_COLUMNS
    }

    /// Returns the class of a group's sources.
    #[inline(always)]
    pub(super) fn class(&self, group: u32) -> usize {
        self.groups.class(group, self.sources.classes)
    }
}

impl<'a, L: Lists> Pending<'a, L> {
    /// Starts the search of a query. Its neighbours in time give the first bound. They would not fill the lists of every class.
    #[inline(always)]
    pub(super) fn new<S: Simd>(
        simd: S,
        pool: Pool<'_>,
        queries: &Queries<'a>,
        query: usize,
        k: usize,
    ) -> Self {
        let findable = queries.findable();
        let state = queries.states().row(queries.row(query));
        let mut lists = L::requested(queries, query, k);
        if !L::BY_CLASS {
            for transition in queries.near_in_time(query, k + 2) {
                let distance = state_distance(simd, state, pool.sources.state(transition));
                let candidate = Candidate { squared: pool.margin.upper(distance), transition };
                lists.offer(0, candidate, findable);
            }
        }
        let cap = lists.radius();
        if !L::BY_CLASS {
            lists.clear();
        }
        let forbidden = queries.forbidden(query);
        let met = Vec::with_capacity(if pool.measures_at_once::<L>() { 0 } else { 4 * k });
        let threshold = -1.0;
        let most = MOST_MET;
        let looked = 0;
        let mut this =
            Self { state, forbidden, findable, lists, cap, threshold, met, most, looked };
        this.narrow(pool.margin);
        this
    }

    fn narrow(&mut self, margin: Margin) {
        // A negative threshold means that no member needs this query.
        self.threshold = self.radius().map_or(-1.0, |radius| margin.threshold(radius));
    }

    /// Returns the query's state.
    pub(super) fn state(&self) -> &'a [f32] {
        self.state
    }

    /// Returns a bound on the squared distance of every source that can still enter a list, or `None` if no source
    /// can.
    pub(super) fn radius(&self) -> Option<f64> {
        let radius = self.cap.min(self.lists.radius());
        (radius >= 0.0).then_some(radius)
    }

    /// Returns the [`radius`](Self::radius) of the sources of one class.
    #[inline(always)]
    pub(super) fn radius_in(&self, class: usize) -> Option<f64> {
        let radius = self.cap.min(self.lists.radius_in(class));
        (radius >= 0.0).then_some(radius)
    }

    /// Whether a source of a class at this squared distance, an f32 sum, can still enter a list.
    #[inline(always)]
    fn is_near(&self, distance: f32, class: usize, margin: Margin) -> bool {
        distance <= self.threshold
            && (!L::BY_CLASS
                || self.radius_in(class).is_some_and(|radius| distance <= margin.threshold(radius)))
    }

    /// Drops the bound from neighbours in time, because a search that ends early may not visit them.
    pub(super) fn forget_neighbours_in_time(&mut self, margin: Margin) {
        self.cap = f64::INFINITY;
        self.narrow(margin);
    }

    /// Whether every list is full.
    pub(super) fn is_full(&self) -> bool {
        self.lists.radius() < f64::INFINITY
    }

    pub(super) fn looked(&self) -> u64 {
        self.looked
    }

    /// Offers the sources of a group, which are of this class. Returns whether the radius of their class has become smaller.
    #[inline(always)]
    pub(super) fn meet<S: Simd>(
        &mut self,
        simd: S,
        pool: Pool<'_>,
        group: u32,
        class: usize,
    ) -> bool {
        let transitions = pool.groups.transitions(group as usize);
        if transitions.iter().all(|transition| self.forbidden.contains(transition)) {
            return false;
        }
        self.looked += 1;
        if pool.measures_at_once::<L>() {
            return self.measure(pool, group, class);
        }
        let distance = state_distance(simd, self.state, pool.state(group));
        if !self.is_near(distance, class, pool.margin) {
            return false;
        }
        if self.met.len() >= self.most {
            self.forget(pool);
        }
        self.met.push((distance, group));
        let before = self.lists.radius_in(class);
        let upper = pool.margin.upper(distance);
        let lists = &mut self.lists;
        pool.groups.offer(group as usize, upper, &self.forbidden, class, lists, self.findable);
        let nearer = self.lists.radius_in(class) < before;
        if nearer {
            self.narrow(pool.margin);
        }
        nearer
    }

    /// Offers the sources of a group by the definition of the distance.
    #[inline(always)]
    fn measure(&mut self, pool: Pool<'_>, group: u32, class: usize) -> bool {
        let squared = squared(self.state, pool.state(group));
        let before = self.lists.radius_in(class);
        if squared > before {
            return false;
        }
        let lists = &mut self.lists;
        pool.groups.offer(group as usize, squared, &self.forbidden, class, lists, self.findable);
        self.lists.radius_in(class) < before
    }

    /// Discards groups that cannot be in a list. Some are too far by now. Others are as near as very many sources,
    /// as in a long standstill, but the definition ranks them behind groups that were already collected.
    #[cold]
    fn forget(&mut self, pool: Pool<'_>) {
        self.keep_near(pool);
        if 2 * self.met.len() > self.most {
            let mut lists = self.lists.clone();
            self.judge(pool, &mut lists);
            let mut listed: Vec<u32> = lists.all().map(|transition| transition.0).collect();
            listed.sort_unstable();
            self.met.retain(|&(_, group)| {
                pool.groups
                    .transitions(group as usize)
                    .iter()
                    .any(|transition| listed.binary_search(transition).is_ok())
            });
        }
        self.most = MOST_MET.max(2 * self.met.len());
    }

    /// Discards groups that are too far by now.
    fn keep_near(&mut self, pool: Pool<'_>) {
        let mut met = std::mem::take(&mut self.met);
        met.retain(|&(distance, group)| self.is_near(distance, pool.class(group), pool.margin));
        self.met = met;
    }

    /// Fills `lists` by the definition from the collected groups.
    fn judge(&self, pool: Pool<'_>, lists: &mut L) {
        lists.clear();
        for four in self.met.chunks(4) {
            let states = [0, 1, 2, 3].map(|i: usize| pool.state(four[i.min(four.len() - 1)].1));
            for (&(_, group), squared) in four.iter().zip(squared_of_four(self.state, states)) {
                let forbidden = &self.forbidden;
                let class = pool.class(group);
                pool.groups.offer(group as usize, squared, forbidden, class, lists, self.findable);
            }
        }
    }

    /// Returns the lists by the definition, from the groups that can be in them.
    pub(super) fn finish(mut self, pool: Pool<'_>) -> L {
        if pool.measures_at_once::<L>() {
            return self.lists;
        }
        self.keep_near(pool);
        let mut lists = std::mem::take(&mut self.lists);
        self.judge(pool, &mut lists);
        lists
    }
}

/// Returns the squared distance of two states as an f32 sum.
#[inline(always)]
fn state_distance<S: Simd>(simd: S, a: &[f32], b: &[f32]) -> f32 {
    let (a, a_tail) = S::as_simd_f32s(a);
    let (b, b_tail) = S::as_simd_f32s(b);
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
    let a = simd.partial_load_f32s(a_tail);
    let b = simd.partial_load_f32s(b_tail);
    let difference = simd.sub_f32s(a, b);
    sums[1] = simd.mul_add_e_f32s(difference, difference, sums[1]);
    let sum = simd.add_f32s(simd.add_f32s(sums[0], sums[1]), simd.add_f32s(sums[2], sums[3]));
    simd.reduce_sum_f32s(sum)
}

#[cfg(test)]
mod tests {
    use calib_core::{Segments, States, TransitionIndex, Transitions};

    use super::*;
    use crate::{Blocks, Exclusion, MemberLists};

    /// Returns the transitions in a member's list.
    fn found(lists: &MemberLists, member: usize) -> Vec<TransitionIndex> {
        lists.of(member).map(|(transition, _)| transition).collect()
    }

    #[test]
    fn a_standstill_is_not_remembered_row_by_row() {
        let rows = 20 * MOST_MET;
        // Two states alternate, equally far from the query's.
        let values =
            (0..rows).flat_map(|row| if row == 7 { [0.5, 0.0] } else { [1.0, (row % 2) as f32] });
        let states = States::new(values.collect(), rows, 2).expect("finite");
        let transitions = Transitions::new(Segments::from_lengths([rows]).expect("valid"));
        let blocks = Blocks::new(&transitions, 3).expect("valid");
        let sources = Sources::new(&states, &transitions, &blocks).expect("valid");
        let queries =
            Queries::next_states(&sources, Exclusion { theiler: 2, ..Exclusion::default() });
        let groups = Groups::singletons(&sources);
        let pool = Pool { sources: &sources, groups: &groups, margin: Margin::new(2) };
        let simd = pulp::Scalar;
        let mut one: Pending<'_, MemberLists> = Pending::new(simd, pool, &queries, 6, 3);
        one.forget_neighbours_in_time(pool.margin);
        let mut most = 0;
        for group in (0..groups.len() as u32).rev() {
            one.meet(simd, pool, group, 0);
            most = most.max(one.met.len());
        }
        assert!((MOST_MET / 2..=MOST_MET).contains(&most), "{most}");
        let lists = one.finish(pool);
        assert_eq!(found(&lists, 1), [0, 2, 4].map(TransitionIndex::new));
        assert_eq!(found(&lists, 0), []);
        assert_eq!(found(&lists, 2), [0, 2, 4].map(TransitionIndex::new));
    }
}
