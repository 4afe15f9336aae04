use calib_core::{Seed, TransitionIndex};
use rayon::prelude::*;

use crate::{
    KnnModel,
    distance::{squared_of_four, stored},
};

/// How a model's tables compare with a search by brute force.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Verification {
    /// Table rows that were searched again.
    pub rows: usize,
    /// Rows whose neighbours and distances are identical.
    pub identical: usize,
    /// The rows that differ, as (member, transition), in order.
    pub different: Vec<(usize, TransitionIndex)>,
}

impl Verification {
    /// Whether every row that was searched again is identical.
    pub fn agrees(&self) -> bool {
        self.different.is_empty()
    }
}

/// Search `sample` random rows of every member again by brute force in f64, and compare.
///
/// Each row costs a pass over all states. If a member has no more than `sample` rows, all are searched.
pub fn verify(model: &KnnModel, sample: usize, seed: Seed) -> Verification {
    let cells = sampled(model, sample, seed);
    let different: Vec<_> = cells
        .par_iter()
        .copied()
        .filter(|&(number, transition)| {
            let (neighbors, distances) = model.member(number).neighbors(transition);
            let expected = brute_force(model, number, transition);
            !expected
                .iter()
                .map(|&(squared, j)| (j, stored(squared)))
                .eq(neighbors.iter().copied().zip(distances.iter().copied()))
        })
        .collect();
    Verification { rows: cells.len(), identical: cells.len() - different.len(), different }
}

/// `sample` random rows of every member, or all of them if there are no more.
pub(crate) fn sampled(
    model: &KnnModel,
    sample: usize,
    seed: Seed,
) -> Vec<(usize, TransitionIndex)> {
    let mut cells = Vec::new();
    for number in 0..model.members() {
        let member = model.member(number);
        if sample >= member.len() {
            cells.extend((0..member.len()).map(|position| (number, member.nth(position))));
            continue;
        }
        let mut rng = seed.child("verify").number(number as u64).rng();
        cells.extend((0..sample).map(|_| (number, member.nth(rng.below(member.len())))));
    }
    cells
}

/// The list of one table row, straight from the definition.
pub(crate) fn brute_force(
    model: &KnnModel,
    member: usize,
    transition: TransitionIndex,
) -> Vec<(f64, u32)> {
    let transitions = model.transitions();
    let query = transitions.next(transition);
    let forbidden = model.exclusion().forbidden(transitions, query);
    let state = model.states().row(query.get());
    let k = model.k();
    let mut nearest: Vec<(f64, u32)> = Vec::with_capacity(k + 1);
    let source = |j: u32| model.states().row(transitions.source(TransitionIndex(j)).get());
    let mut rest = model.blocks().transitions_of(member).filter(|j| !forbidden.contains(&j.0));
    // Four at a time: sums in order wait for each other.
    while let Some(TransitionIndex(first)) = rest.next() {
        let mut four = [first; 4];
        let mut count = 1;
        for (place, j) in four[1..].iter_mut().zip(&mut rest) {
            *place = j.0;
            count += 1;
        }
        let distances = squared_of_four(state, four.map(source));
        for (&j, &distance) in four[..count].iter().zip(&distances) {
            // In the order of rows: of equal distances the first stays before the others.
            let place = nearest.partition_point(|&(other, _)| other <= distance);
            if place < k {
                nearest.truncate(k - 1);
                nearest.insert(place, (distance, j));
            }
        }
    }
    nearest
}
