use std::ops::Range;

use crate::{RowIndex, Segments, States};

/// The states that an agent sees: a sequence in one or more unbroken pieces.
///
/// An agent cannot tell a recorded stream (replay) from a generated one (rollout).
pub trait Stream: Send + Sync {
    /// Returns the number of states.
    fn len(&self) -> usize;

    /// Whether there are no states.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the number of values in a state.
    fn width(&self) -> usize;

    /// Returns the state at time `t`.
    fn state(&self, t: usize) -> &[f32];

    /// Returns the unbroken pieces, in order, that partition `0..len`. No transition, trace or return crosses from one
    /// into the next.
    fn pieces(&self) -> &[Range<usize>];
}

/// A stream of recorded rows. By construction it cannot leave the data.
#[derive(Clone, Debug)]
pub struct RowStream {
    states: States,
    rows: Vec<RowIndex>,
    pieces: Vec<Range<usize>>,
}

impl RowStream {
    /// Returns one unbroken piece that visits `rows` in this order.
    ///
    /// # Panics
    /// If a row lies outside `states`.
    pub fn unbroken(states: States, rows: Vec<RowIndex>) -> Self {
        assert!(
            rows.iter().all(|row| row.get() < states.rows()),
            "a stream visits recorded rows only"
        );
        let pieces = (!rows.is_empty()).then_some(0..rows.len()).into_iter().collect();
        Self { states, rows, pieces }
    }

    /// Returns the replay of all rows of `segments` in time order, one piece per segment.
    ///
    /// # Panics
    /// If the segments have more rows than `states`.
    pub fn replay(states: States, segments: &Segments) -> Self {
        assert!(segments.rows() <= states.rows(), "a stream visits recorded rows only");
        let rows = (0..segments.rows()).map(RowIndex::new).collect();
        let pieces = segments.iter().map(crate::Segment::rows).collect();
        Self { states, rows, pieces }
    }

    /// Returns the cyclic replay of `length` rows from `start` on in time order: the first row follows the last. There
    /// is one piece for each visited segment, and a new one whenever the rows begin again.
    ///
    /// # Panics
    /// If there are no rows, `start` is not one of them, or the segments reach past `states`.
    pub fn looped(states: States, segments: &Segments, start: usize, length: usize) -> Self {
        let count = segments.rows();
        assert!(start < count && count <= states.rows(), "a stream visits recorded rows only");
        let rows = (start..count).chain((0..count).cycle()).take(length).map(RowIndex::new);
        Self { states, rows: rows.collect(), pieces: segments.looped_pieces(start, length) }
    }

    /// Returns the rows in the order in which they are visited.
    pub fn rows(&self) -> &[RowIndex] {
        &self.rows
    }
}

impl Stream for RowStream {
    fn len(&self) -> usize {
        self.rows.len()
    }

    fn width(&self) -> usize {
        self.states.columns()
    }

    fn state(&self, t: usize) -> &[f32] {
        self.states.row(self.rows[t].get())
    }

    fn pieces(&self) -> &[Range<usize>] {
        &self.pieces
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replay_keeps_segments_apart() {
        let states = States::new(vec![0.0, 1.0, 2.0], 3, 1).expect("valid");
        let segments = Segments::from_lengths([2, 1]).expect("valid");
        let stream = RowStream::replay(states.clone(), &segments);
        assert_eq!(stream.pieces(), [0..2, 2..3]);
        let looped = RowStream::looped(states.clone(), &segments, 1, 6);
        let rows: Vec<u32> = looped.rows().iter().map(|row| row.0).collect();
        assert_eq!(rows, [1, 2, 0, 1, 2, 0]);
        assert_eq!(looped.pieces(), [0..1, 1..2, 2..4, 4..5, 5..6]);
        let stream = RowStream::unbroken(states, vec![RowIndex(2), RowIndex(0)]);
        assert_eq!((stream.state(0), stream.state(1)), (&[2.0_f32][..], &[0.0_f32][..]));
    }
}
