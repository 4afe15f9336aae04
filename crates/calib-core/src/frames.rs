use std::ops::Range;

use crate::{Segments, States, Timestamp};

/// Normalised rows in time order, with their segments.
#[derive(Clone, Debug)]
pub struct Frames {
    timestamps: Vec<Timestamp>,
    segments: Segments,
    states: States,
}

/// An error that prevents parts from forming frames.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FramesError {
    /// Timestamps, segments and states disagree about the number of rows.
    #[error(
        "{timestamps} timestamps, {segments} rows in segments and {states} states must be equal"
    )]
    Rows {
        /// Number of timestamps.
        timestamps: usize,
        /// Number of rows in the segments.
        segments: usize,
        /// Number of states.
        states: usize,
    },
    /// Timestamps do not increase.
    #[error("row {row} is not later than the row before it")]
    Order {
        /// First row out of order.
        row: usize,
    },
}

impl Frames {
    /// Returns frames of rows in strictly increasing time order.
    ///
    /// # Errors
    /// If the parts disagree about the number of rows, or time does not increase.
    pub fn new(
        timestamps: Vec<Timestamp>,
        segments: Segments,
        states: States,
    ) -> Result<Self, FramesError> {
        if timestamps.len() != segments.rows() || timestamps.len() != states.rows() {
            return Err(FramesError::Rows {
                timestamps: timestamps.len(),
                segments: segments.rows(),
                states: states.rows(),
            });
        }
        if let Some(before) = timestamps.windows(2).position(|pair| pair[1] <= pair[0]) {
            return Err(FramesError::Order { row: before + 1 });
        }
        Ok(Self { timestamps, segments, states })
    }

    /// Returns some of the rows. Segments are cut where the rows begin and end.
    ///
    /// # Panics
    /// If there are fewer rows.
    #[must_use]
    pub fn slice(&self, rows: Range<usize>) -> Self {
        let lengths = self.segments.iter().filter_map(|segment| {
            let segment = segment.rows();
            let inside = segment.start.max(rows.start)..segment.end.min(rows.end);
            (!inside.is_empty()).then(|| inside.len())
        });
        let segments = Segments::from_lengths(lengths)
            .unwrap_or_else(|_| unreachable!("parts of segments are not empty"));
        let states = self.states.slice(rows.clone());
        Self { timestamps: self.timestamps[rows].to_vec(), segments, states }
    }

    /// Returns the number of rows.
    pub fn rows(&self) -> usize {
        self.timestamps.len()
    }

    /// Returns the time of each row.
    pub fn timestamps(&self) -> &[Timestamp] {
        &self.timestamps
    }

    /// Returns the segments: runs of rows without a gap.
    pub fn segments(&self) -> &Segments {
        &self.segments
    }

    /// Returns the normalised states.
    pub fn states(&self) -> &States {
        &self.states
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns two states of one value.
    fn states() -> States {
        States::new(vec![0.0; 2], 2, 1).expect("valid")
    }

    /// Returns one segment of two rows.
    fn segments() -> Segments {
        Segments::from_lengths([2]).expect("valid")
    }

    #[test]
    fn parts_must_agree() {
        let at = Timestamp::from_micros;
        assert!(Frames::new(vec![at(0), at(1)], segments(), states()).is_ok());
        let order = Frames::new(vec![at(1), at(1)], segments(), states()).expect_err("a repeat");
        assert_eq!(order, FramesError::Order { row: 1 });
        assert!(matches!(
            Frames::new(vec![at(0)], segments(), states()),
            Err(FramesError::Rows { .. })
        ));
    }

    #[test]
    fn a_slice_cuts_segments() {
        let times = (0..6).map(Timestamp::from_micros).collect();
        let segments = Segments::from_lengths([2, 3, 1]).expect("valid");
        let states = States::new((0..6).map(|row| row as f32).collect(), 6, 1).expect("valid");
        let slice = Frames::new(times, segments, states).expect("valid").slice(1..4);
        assert_eq!(slice.segments(), &Segments::from_lengths([1, 2]).expect("valid"));
        assert_eq!(slice.states().as_slice(), [1.0, 2.0, 3.0]);
        assert_eq!(slice.timestamps()[0], Timestamp::from_micros(1));
    }
}
