//! Sums over the rows that a predictor is fitted on, stored separately for the folds of a cross-validation.

use std::ops::Range;

use super::solve::{Square, dot};

/// Number of folds of the cross-validation.
const FOLDS: usize = 5;

/// Rows in time order, cut into folds. Each fold has a first, a middle and a last part. The outer parts separate a fold
/// from its neighbours, because returns near the border share the same future.
#[derive(Clone, Debug)]
pub(super) struct Folds {
    /// Steps that predictors are fitted on.
    pub(super) rows: Vec<usize>,
    /// Ranges of positions in `rows`, three parts per fold.
    parts: Vec<Range<usize>>,
}

impl Folds {
    /// Cuts `rows` into folds, separated by a horizon of `gap` steps, or by half a fold where folds are shorter than
    /// that.
    pub(super) fn new(rows: Vec<usize>, gap: usize) -> Self {
        let count = rows.len();
        let mut parts = Vec::with_capacity(3 * FOLDS);
        for fold in 0..FOLDS {
            let fold = fold * count / FOLDS..(fold + 1) * count / FOLDS;
            let within = &rows[fold.clone()];
            let mut first = 0;
            let mut last = 0;
            if let (Some(&start), Some(&end)) = (within.first(), within.last()) {
                first = within.partition_point(|&t| t < start + gap).min(within.len() / 2);
                let after = within.partition_point(|&t| t + gap <= end);
                last = (within.len() - after).min(within.len() / 2);
            }
            let first = fold.start + first;
            let last = (fold.end - last).max(first);
            parts.extend([fold.start..first, first..last, last..fold.end]);
        }
        Self { rows, parts }
    }

    /// Returns the second moments of each part, of the features that `write` computes for a step.
    pub(super) fn second_moments(
        &self,
        size: usize,
        mut write: impl FnMut(usize, &mut [f64]),
    ) -> Vec<Square> {
        let mut features = vec![0.0; size];
        self.each_part(|rows| {
            let mut sums = Square::zeros(size);
            for &t in rows {
                write(t, &mut features);
                for (row, &left) in features.iter().enumerate() {
                    // Only the upper triangle; the lower one is mirrored once for all rows.
                    for (sum, right) in sums.row_mut(row)[row..].iter_mut().zip(&features[row..]) {
                        *sum += left * right;
                    }
                }
            }
            for row in 0..size {
                for column in 0..row {
                    sums.values[row * size + column] = sums.values[column * size + row];
                }
            }
            sums
        })
    }

    /// Returns for each part the sums of products of two feature vectors. The first vector indexes the rows.
    pub(super) fn cross_moments(
        &self,
        size: usize,
        mut write: impl FnMut(usize, &mut [f64], &mut [f64]),
    ) -> Vec<Square> {
        let mut left = vec![0.0; size];
        let mut right = vec![0.0; size];
        self.each_part(|rows| {
            let mut sums = Square::zeros(size);
            for &t in rows {
                write(t, &mut left, &mut right);
                for (row, &factor) in left.iter().enumerate() {
                    for (sum, value) in sums.row_mut(row).iter_mut().zip(&right) {
                        *sum += factor * value;
                    }
                }
            }
            sums
        })
    }

    /// Returns for each part the sums of features times a target.
    pub(super) fn target_moments(
        &self,
        size: usize,
        mut write: impl FnMut(usize, &mut [f64]),
        target: impl Fn(usize) -> f64,
    ) -> Vec<Target> {
        let mut features = vec![0.0; size];
        self.each_part(|rows| {
            let mut sums = Target { products: vec![0.0; size], square: 0.0 };
            for &t in rows {
                write(t, &mut features);
                let y = target(t);
                for (sum, feature) in sums.products.iter_mut().zip(&features) {
                    *sum += feature * y;
                }
                sums.square += y * y;
            }
            sums
        })
    }

    fn each_part<T>(&self, mut sum: impl FnMut(&[usize]) -> T) -> Vec<T> {
        self.parts.iter().map(|part| sum(&self.rows[part.clone()])).collect()
    }

    /// Returns the number of rows in a set of parts.
    pub(super) fn count(&self, parts: &[usize]) -> usize {
        parts.iter().map(|&part| self.parts[part].len()).sum()
    }

    pub(super) fn all(&self) -> Vec<usize> {
        (0..self.parts.len()).collect()
    }

    pub(super) fn rows_of(&self, part: usize) -> &[usize] {
        &self.rows[self.parts[part].clone()]
    }

    /// Returns the splits that validate each later fold with a fit to all folds before it.
    pub(super) fn splits_ahead() -> Vec<Split> {
        (FOLDS / 2..FOLDS)
            .map(|fold: usize| Split {
                fitted: (0..3 * fold - 1).collect(),
                judged: (3 * fold..3 * fold + 3).collect(),
            })
            .collect()
    }

    /// Returns the steps of the later folds.
    pub(super) fn rows_ahead(&self) -> impl Iterator<Item = usize> {
        let parts = Self::splits_ahead().into_iter().flat_map(|split| split.judged);
        parts.flat_map(|part| self.rows_of(part).iter().copied())
    }

    /// Returns the squared error over the later folds of the solutions that `solve` gives for the parts before them.
    /// Infinite if there is no solution.
    pub(super) fn error_ahead(
        second: &[Square],
        targets: &[Target],
        solve: impl Fn(&[usize]) -> Option<Vec<f64>>,
    ) -> f64 {
        let mut total = 0.0;
        for split in Self::splits_ahead() {
            let Some(weights) = solve(&split.fitted) else { return f64::INFINITY };
            let judged = Target::sum(targets, &split.judged);
            total += judged.squared_error(&sum(second, &split.judged), &weights);
        }
        total
    }

    /// Returns the squared error in each fold that others can predict, where `error` gives the error at a step.
    pub(super) fn errors_across(&self, error: impl Fn(usize) -> f64) -> Vec<f64> {
        self.splits()
            .iter()
            .map(|split| {
                split
                    .judged
                    .iter()
                    .map(|&part| -> f64 {
                        self.rows_of(part).iter().map(|&t| error(t).powi(2)).sum()
                    })
                    .sum()
            })
            .collect()
    }

    /// Returns the squared error in each fold of the solution that `solve` gives for the others, or `None` without a
    /// solution.
    pub(super) fn cross_errors(
        &self,
        second: &[Square],
        targets: &[Target],
        solve: impl Fn(&[usize]) -> Option<Vec<f64>>,
    ) -> Option<Vec<f64>> {
        self.splits()
            .iter()
            .map(|split| {
                let judged = Target::sum(targets, &split.judged);
                let error =
                    judged.squared_error(&sum(second, &split.judged), &solve(&split.fitted)?);
                error.is_finite().then_some(error)
            })
            .collect()
    }

    /// Returns the training and validation parts of each fold that has both.
    pub(super) fn splits(&self) -> Vec<Split> {
        (0..FOLDS)
            .map(|fold: usize| {
                let own = 3 * fold..3 * fold + 3;
                let apart = own.start.saturating_sub(1)..own.end + 1;
                Split {
                    fitted: self.all().into_iter().filter(|part| !apart.contains(part)).collect(),
                    judged: own.collect(),
                }
            })
            .filter(|split| self.count(&split.fitted) > 0 && self.count(&split.judged) > 0)
            .collect()
    }
}

/// The training and validation parts of one fold of the cross-validation.
#[derive(Clone, Debug)]
pub(super) struct Split {
    pub(super) fitted: Vec<usize>,
    pub(super) judged: Vec<usize>,
}

/// Sums of a target over some rows.
#[derive(Clone, Debug)]
pub(super) struct Target {
    /// Sums of features times the target.
    pub(super) products: Vec<f64>,
    /// Sum of the squared target.
    pub(super) square: f64,
}

impl Target {
    pub(super) fn sum(all: &[Self], parts: &[usize]) -> Self {
        let mut sum = Self { products: vec![0.0; all[0].products.len()], square: 0.0 };
        for &part in parts {
            for (sum, value) in sum.products.iter_mut().zip(&all[part].products) {
                *sum += value;
            }
            sum.square += all[part].square;
        }
        sum
    }

    /// Returns Σ (y − w · x)² over rows with these second moments.
    pub(super) fn squared_error(&self, second: &Square, weights: &[f64]) -> f64 {
        self.square - 2.0 * dot(&self.products, weights) + dot(weights, &second.times(weights))
    }
}

/// Returns the sum of the moments of some parts.
pub(super) fn sum(all: &[Square], parts: &[usize]) -> Square {
    let mut sum = Square::zeros(all[0].size);
    for &part in parts {
        sum.add(1.0, &all[part]);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_separates_what_is_fitted_from_what_is_judged() {
        let folds = Folds::new((0..1000).collect(), 30);
        let splits = folds.splits();
        assert_eq!(splits.len(), 5);
        for (fold, split) in splits.iter().enumerate() {
            let [judged, fitted] = [&split.judged, &split.fitted].map(|parts| -> Vec<usize> {
                let ranges = parts.iter().map(|&part| folds.parts[part].clone());
                ranges.flat_map(|range| folds.rows[range].to_vec()).collect()
            });
            assert_eq!(judged, (200 * fold..200 * (fold + 1)).collect::<Vec<_>>());
            for t in fitted {
                assert!(judged.iter().all(|other| other.abs_diff(t) >= 30), "{t}");
            }
        }
    }

    #[test]
    fn folds_that_are_shorter_than_the_gap_keep_half_of_their_neighbours() {
        let folds = Folds::new((0..100).collect(), 500);
        let middle = &folds.splits()[2];
        assert_eq!((folds.count(&middle.judged), folds.count(&middle.fitted)), (20, 60));
        assert_eq!(Folds::new(vec![3, 9], 1).splits().len(), 2);
    }
}
