//! Outliers: states far from all others.

use std::ops::{Range, RangeInclusive};

/// States further from the mean than this many times the usual distance are far.
pub(super) const FAR: f64 = 16.0;
/// Bound on the relative error of a distance from the mean in f64, with some reserve.
const ROUNDING: f64 = 1e-9;

/// A few states so far from the mean that they are kept out of the tree. The rounding of images grows with the largest distance from
/// the mean, so a spike of one sensor would blur the images of all states.
///
/// They are stored after the states of the tree, in order of their distance from the mean. The bound for pruning is
/// `‖x − y‖ ≥ |‖x − μ‖ − ‖y − μ‖|`.
#[derive(Debug)]
pub(super) struct Far {
    /// The position of the first far state.
    first: u32,
    /// Distances from the mean, ascending.
    norms: Vec<f64>,
}

impl Far {
    /// Creates the far states at positions from `first` on, with their distances from the mean.
    pub(super) fn new(first: u32, norms: Vec<f64>) -> Self {
        Self { first, norms }
    }

    /// Returns the maximum number of states that are worth keeping apart from `count` states.
    pub(super) fn most(count: usize) -> usize {
        64 + count / 1024
    }

    /// Returns the positions of the far states that can be within `radius` of a state whose distance from the mean is in `norm`.
    pub(super) fn within(&self, norm: RangeInclusive<f64>, radius: f64) -> Range<u32> {
        let (low, high) = norm.into_inner();
        let start = self.norms.partition_point(|&far| apart(low, far, radius));
        let end = self.norms.partition_point(|&far| !apart(far, high, radius));
        self.first + start as u32..self.first + end.max(start) as u32
    }
}

/// Whether two states are surely further than `radius` apart: one is at least `further` from the mean, the other at most `nearer`.
pub(super) fn apart(further: f64, nearer: f64, radius: f64) -> bool {
    further - nearer - ROUNDING * (further + nearer) > radius
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_can_be_near_enough() {
        let far = Far::new(5, vec![100.0, 200.0, 1e6, 1e20]);
        assert_eq!(far.within(0.0..=1.0, 50.0), 5..5);
        assert_eq!(far.within(0.0..=1.0, 99.0), 5..6);
        assert_eq!(far.within(190.0..=190.0, 20.0), 6..7);
        assert_eq!(far.within(2e6..=2e6, 1e6), 7..8);
        assert_eq!(far.within(1e20..=1e20, 0.0), 8..9);
        assert_eq!(far.within(0.0..=1.0, f64::INFINITY), 5..9);
    }
}
