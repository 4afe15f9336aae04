use calib_core::{Monitor, Seed, TransitionIndex};

use crate::{
    KnnError, KnnModel,
    definition::{Cell, by_definition},
    distance::stored,
};

/// The comparison of a model's tables with a brute-force search.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Verification {
    /// Number of table rows that were searched again.
    pub rows: usize,
    /// Number of rows whose neighbours and distances are identical.
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

/// Searches `sample` random rows of every member again by brute force in f64, and compares.
///
/// The states are read once for all rows together. If a member has no more than `sample` rows, all are searched. Progress
/// counts sources.
///
/// # Errors
/// If the monitor interrupts.
pub fn verify(
    model: &KnnModel,
    sample: usize,
    seed: Seed,
    monitor: &dyn Monitor,
) -> Result<Verification, KnnError> {
    let cells = sampled(model, sample, seed);
    let lists = by_definition(model, &cells, monitor)?;
    let rows = cells.len();
    let different: Vec<Cell> = cells
        .into_iter()
        .zip(lists)
        .filter(|&((number, transition), ref expected)| {
            let (neighbors, distances) = model.member(number).neighbors(transition);
            let table = neighbors.iter().copied().zip(distances.iter().copied());
            !expected.iter().map(|&(squared, j)| (j, stored(squared))).eq(table)
        })
        .map(|(cell, _)| cell)
        .collect();
    Ok(Verification { rows, identical: rows - different.len(), different })
}

/// Returns `sample` random rows of every member, or all rows if there are no more.
pub(crate) fn sampled(model: &KnnModel, sample: usize, seed: Seed) -> Vec<Cell> {
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
