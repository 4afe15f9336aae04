use std::ops::Range;

use calib_core::Seed;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::{KnnModel, verify};

/// What a search leaves out to be faster: then its tables are approximate, and [`recall`] says how good they are.
///
/// The paper names both ways for data that is too large for exact search. Prototypes are every m-th transition in time
/// order: in densely sampled logs the others are near copies of them (our choice; the paper does not say which).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shortcuts {
    /// One source in this many, in time order, can be a neighbour; 1 for all.
    pub prototypes: u32,
    /// Most leaves that the join visits for a band of queries beside their own, nearest first; 0 for as many as it takes.
    /// It wants the join.
    pub leaf_budget: usize,
}

impl Default for Shortcuts {
    fn default() -> Self {
        Self { prototypes: 1, leaf_budget: 0 }
    }
}

impl Shortcuts {
    /// Whether nothing is left out.
    pub fn is_exact(self) -> bool {
        self == Self::default()
    }

    /// How many transitions of `range` can be neighbours.
    pub(crate) fn count(self, range: &Range<u32>) -> usize {
        let before = |end: u32| end.div_ceil(self.prototypes) as usize;
        if range.is_empty() { 0 } else { before(range.end) - before(range.start) }
    }

    /// Whether `transition` can be a neighbour.
    pub(crate) fn keeps(self, transition: u32) -> bool {
        transition.is_multiple_of(self.prototypes)
    }
}

/// How many of the neighbours in a model's tables are among the true ones.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Recall {
    /// Table rows that were searched again.
    pub rows: usize,
    /// Share of the neighbours that are no further than the true `k`-th neighbour is.
    pub recall: f64,
    /// Mean over rows of the table's `k`-th distance by the true one; rows where the true one is 0 do not count.
    pub distance_ratio: f64,
}

/// Compare `sample` random rows of every member with brute force in f64 over all sources of the member.
///
/// Each row costs a pass over all states.
pub fn recall(model: &KnnModel, sample: usize, seed: Seed) -> Recall {
    let cells = verify::sampled(model, sample, seed);
    let rows: Vec<(usize, Option<f64>)> = cells
        .par_iter()
        .map(|&(number, transition)| {
            let (_, distances) = model.member(number).neighbors(transition);
            let exact = verify::brute_force(model, number, transition);
            let Some(&(squared, _)) = exact.last() else { return (0, None) };
            let furthest = crate::distance::stored(squared);
            let found = distances.iter().filter(|&&distance| distance <= furthest).count();
            let last = distances.last().copied().unwrap_or(f32::INFINITY);
            let ratio = (furthest > 0.0).then(|| f64::from(last) / f64::from(furthest));
            (found, ratio)
        })
        .collect();
    let found: usize = rows.iter().map(|row| row.0).sum();
    let ratios: Vec<f64> = rows.iter().filter_map(|row| row.1).collect();
    let mean = ratios.iter().sum::<f64>() / ratios.len().max(1) as f64;
    Recall {
        rows: rows.len(),
        recall: found as f64 / (rows.len() * model.k()).max(1) as f64,
        distance_ratio: if ratios.is_empty() { 1.0 } else { mean },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prototypes_are_counted() {
        let shortcuts = Shortcuts { prototypes: 4, leaf_budget: 0 };
        for start in 0..14 {
            for end in start..14 {
                let expected = (start..end).filter(|&t| shortcuts.keeps(t)).count();
                assert_eq!(shortcuts.count(&(start..end)), expected, "{start}..{end}");
            }
        }
        assert!(Shortcuts::default().is_exact() && !shortcuts.is_exact());
    }
}
