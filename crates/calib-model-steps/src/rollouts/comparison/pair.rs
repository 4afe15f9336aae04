//! One rollout with the record after the same start state, and their distances.

use calib_core::Timestamp;

use super::MEASURES;
use crate::STEP_PATTERNS;

/// A rollout and the record, on one sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    pub(super) member: u32,
    pub(super) rollout: u32,
    /// The row that was requested as the start of the rollout, and its time. Rollouts that share it are compared with
    /// the same stretch, and are one observation.
    pub(super) wanted: u32,
    pub(super) start: Timestamp,
    pub(super) sensor: String,
    /// Number of compared steps.
    pub(super) steps: u32,
    /// Raw and normalised distance, in the order of [`STEP_PATTERNS`].
    pub(super) warping: Vec<(f64, Option<f64>)>,
    /// Measures in the order of [`MEASURES`]; `None` where a measure is not defined.
    pub(super) measures: Vec<Option<f64>>,
}

/// One of the distances of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Distance {
    /// Warping with the step pattern at this position.
    Raw(usize),
    /// The same, divided by the length of the path.
    Normalised(usize),
    /// The measure at this position.
    Measure(usize),
}

impl Distance {
    /// Iterates over one distance per step pattern, normalised where that is defined, and one per measure.
    pub(super) fn shown() -> impl Iterator<Item = Self> {
        let warping = (0..STEP_PATTERNS.len()).map(Self::Normalised);
        warping.chain((0..MEASURES.len()).map(Self::Measure))
    }

    /// Returns the label for people.
    pub(super) fn label(self) -> String {
        match self {
            Self::Raw(place) => format!("{} warping, raw", STEP_PATTERNS[place]),
            Self::Normalised(place) => format!("{} warping", STEP_PATTERNS[place]),
            Self::Measure(place) => MEASURES[place].label.to_owned(),
        }
    }

    /// Returns the distance of a pair; `None` where it is not defined.
    pub(super) fn of(self, pair: &Pair) -> Option<f64> {
        match self {
            Self::Raw(place) => Some(pair.warping[place].0),
            Self::Normalised(place) => pair.warping[place].1,
            Self::Measure(place) => pair.measures[place],
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Returns ten steps from `row` on, one row per second, all of whose distances are `value`.
    pub(crate) fn pair(member: u32, row: u32, value: f64) -> Pair {
        Pair {
            member,
            rollout: row,
            wanted: row,
            start: Timestamp::from_micros(i64::from(row) * 1_000_000),
            sensor: "PIT300".to_owned(),
            steps: 10,
            warping: vec![(value, Some(value)); STEP_PATTERNS.len()],
            measures: vec![Some(value); MEASURES.len()],
        }
    }

    #[test]
    fn every_distance_that_is_shown_has_a_name_of_its_own() {
        let mut labels: Vec<String> = Distance::shown().map(Distance::label).collect();
        labels.sort();
        labels.dedup();
        assert_eq!(labels.len(), STEP_PATTERNS.len() + MEASURES.len());
    }
}
