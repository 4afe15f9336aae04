//! States far outside the others.

use std::ops::{Range, RangeInclusive};

/// States further from the mean than this many times the usual distance are far.
pub(super) const FAR: f64 = 16.0;
/// Relative error of a distance from the mean in f64, with room to spare.
const ROUNDING: f64 = 1e-9;

/// A few states so far from the mean that they are kept out of the tree: the rounding of images grows with the largest
/// distance from the mean, and a spike of one sensor would blur those of all states.
///
/// They follow the states of the tree, those nearest to the mean first. What is known of them is
/// `‖x − y‖ ≥ |‖x − μ‖ − ‖y − μ‖|`.
#[derive(Debug)]
pub(super) struct Far {
    /// The place of the first.
    first: u32,
    /// Distances from the mean, ascending.
    norms: Vec<f64>,
}

impl Far {
    /// Far states in places from `first` on, with their distances from the mean.
    pub(super) fn new(first: u32, norms: Vec<f64>) -> Self {
        Self { first, norms }
    }

    /// The most that are worth keeping apart from `count` states.
    pub(super) fn most(count: usize) -> usize {
        64 + count / 1024
    }

    /// The places of those that can be within `radius` of a state whose distance from the mean is in `norm`.
    pub(super) fn within(&self, norm: RangeInclusive<f64>, radius: f64) -> Range<u32> {
        let (low, high) = norm.into_inner();
        let start = self.norms.partition_point(|&far| apart(low, far, radius));
        let end = self.norms.partition_point(|&far| !apart(far, high, radius));
        self.first + start as u32..self.first + end.max(start) as u32
    }
}

/// Whether states so far from the mean, the first at least and the second at most, are surely further than `radius` from each other.
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
