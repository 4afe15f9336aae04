use std::ops::Range;

use serde::{Deserialize, Serialize};

/// A maximal run of rows at the expected sampling interval, as a half-open range of rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Segment {
    /// First row.
    pub start: u32,
    /// One past the last row.
    pub end: u32,
}

impl Segment {
    /// Returns the number of rows.
    pub const fn len(self) -> usize {
        (self.end - self.start) as usize
    }

    /// Whether the segment has no row; never true inside [`Segments`].
    pub const fn is_empty(self) -> bool {
        self.end == self.start
    }

    /// Returns the rows as a range.
    pub const fn rows(self) -> Range<usize> {
        self.start as usize..self.end as usize
    }
}

/// A partition of rows `0..n` into segments, in order.
///
/// No transition, trace, return or rollout crosses from one segment into the next.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Segments(Vec<Segment>);

/// An error that prevents a list of lengths from being a partition.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SegmentError {
    /// A segment without rows.
    #[error("segment {segment} has no rows")]
    Empty {
        /// Position of the segment.
        segment: usize,
    },
    /// More rows than 32 bits can count.
    #[error("{rows} rows exceed the {} that calib can index; sub-sample, or split the data", u32::MAX - 1)]
    TooManyRows {
        /// Total number of rows.
        rows: usize,
    },
}

impl Segments {
    /// Returns the partition whose segments have these lengths, in rows.
    ///
    /// # Errors
    /// A length of zero, or a total above `u32::MAX - 1` rows.
    pub fn from_lengths(lengths: impl IntoIterator<Item = usize>) -> Result<Self, SegmentError> {
        let mut segments = Vec::new();
        let mut start = 0_usize;
        for (segment, length) in lengths.into_iter().enumerate() {
            if length == 0 {
                return Err(SegmentError::Empty { segment });
            }
            let end = start + length;
            if end >= u32::MAX as usize {
                return Err(SegmentError::TooManyRows { rows: end });
            }
            segments.push(Segment { start: start as u32, end: end as u32 });
            start = end;
        }
        Ok(Self(segments))
    }

    /// Returns the number of segments.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are no segments, and so no rows.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Returns the number of rows over all segments.
    pub fn rows(&self) -> usize {
        self.0.last().map_or(0, |last| last.end as usize)
    }

    /// Iterates over the segments in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Segment> + '_ {
        self.0.iter().copied()
    }

    /// Returns the segments as a slice.
    pub fn as_slice(&self) -> &[Segment] {
        &self.0
    }

    /// Returns the position of the segment that holds `row`, or `None` past the last row.
    pub fn position_of(&self, row: usize) -> Option<usize> {
        let position = self.0.partition_point(|segment| (segment.end as usize) <= row);
        (position < self.0.len()).then_some(position)
    }

    /// Returns the unbroken pieces of a stream that visits `length` rows from `start` on, and wraps from the last row
    /// to the first. Pieces are ranges of `0..length`, one for each segment that the stream visits.
    pub fn looped_pieces(&self, start: usize, length: usize) -> Vec<Range<usize>> {
        let rows = self.rows();
        let mut pieces = Vec::new();
        let mut done = 0;
        let mut from = start;
        while done < length && from < rows {
            let to = rows.min(from + length - done);
            for segment in &self.0[self.position_of(from).unwrap_or(self.0.len())..] {
                let Range { start, end } = segment.rows();
                if start >= to {
                    break;
                }
                pieces.push(start.max(from) - from + done..end.min(to) - from + done);
            }
            done += to - from;
            from = 0;
        }
        pieces
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_become_a_partition() {
        let segments = Segments::from_lengths([3, 1, 2]).expect("valid");
        assert_eq!(segments.rows(), 6);
        assert_eq!(segments.as_slice()[1], Segment { start: 3, end: 4 });
        let positions = [0, 2, 3, 4, 5, 6].map(|row| segments.position_of(row));
        assert_eq!(positions, [Some(0), Some(0), Some(1), Some(2), Some(2), None]);
    }

    #[test]
    fn empty_segments_are_refused() {
        assert_eq!(Segments::from_lengths([2, 0]), Err(SegmentError::Empty { segment: 1 }));
        assert!(matches!(
            Segments::from_lengths([u32::MAX as usize]),
            Err(SegmentError::TooManyRows { .. })
        ));
    }
}
