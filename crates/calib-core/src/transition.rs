use crate::{RowIndex, Segments, TransitionIndex};

/// All transitions of some segments, in time order.
///
/// Transition `i` leads from [`source(i)`](Self::source) to the next row,
/// [`next(i)`](Self::next). A segment of `L` rows holds `L - 1` transitions.
#[derive(Clone, Debug)]
pub struct Transitions {
    /// Source row of each transition.
    sources: Vec<u32>,
    /// First transition of each segment, and one past the last transition.
    firsts: Vec<u32>,
    segments: Segments,
}

impl Transitions {
    /// Returns the transitions inside `segments`.
    pub fn new(segments: Segments) -> Self {
        let mut sources = Vec::with_capacity(segments.rows());
        let mut firsts = Vec::with_capacity(segments.len() + 1);
        for segment in segments.iter() {
            firsts.push(sources.len() as u32);
            sources.extend(segment.start..segment.end - 1);
        }
        firsts.push(sources.len() as u32);
        Self { sources, firsts, segments }
    }

    /// Returns the number of transitions.
    pub fn len(&self) -> usize {
        self.sources.len()
    }

    /// Whether there are no transitions, because no segment has two rows.
    pub fn is_empty(&self) -> bool {
        self.sources.is_empty()
    }

    /// Returns the segments of the transitions.
    pub fn segments(&self) -> &Segments {
        &self.segments
    }

    /// Returns the row that the transition starts from.
    pub fn source(&self, transition: TransitionIndex) -> RowIndex {
        RowIndex(self.sources[transition.get()])
    }

    /// Returns the row that the transition leads to.
    pub fn next(&self, transition: TransitionIndex) -> RowIndex {
        RowIndex(self.sources[transition.get()] + 1)
    }

    /// Returns the source rows of all transitions, in order.
    pub fn sources(&self) -> &[u32] {
        &self.sources
    }

    /// Returns the transition that starts from `row`, or `None` for the last row
    /// of a segment.
    pub fn starting_at(&self, row: RowIndex) -> Option<TransitionIndex> {
        let position = self.segments.position_of(row.get())?;
        let segment = self.segments.as_slice()[position];
        (row.0 + 1 < segment.end)
            .then(|| TransitionIndex(self.firsts[position] + (row.0 - segment.start)))
    }

    /// Returns the transition that leads to `row`, or `None` for the first row of
    /// a segment.
    pub fn ending_in(&self, row: RowIndex) -> Option<TransitionIndex> {
        row.0.checked_sub(1).and_then(|before| {
            self.starting_at(RowIndex(before)).filter(|&transition| self.next(transition) == row)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn transitions() -> Transitions {
        Transitions::new(Segments::from_lengths([3, 1, 2]).expect("valid"))
    }

    #[test]
    fn no_transition_crosses_a_segment() {
        let all = transitions();
        assert_eq!(all.sources(), [0, 1, 4]);
        let next: Vec<u32> = (0..3).map(|i| all.next(TransitionIndex(i)).0).collect();
        assert_eq!(next, [1, 2, 5]);
    }

    #[test]
    fn rows_find_their_transitions() {
        let all = transitions();
        let starting: Vec<_> =
            (0..7).map(|row| all.starting_at(RowIndex(row)).map(|t| t.0)).collect();
        assert_eq!(starting, [Some(0), Some(1), None, None, Some(2), None, None]);
        let ending: Vec<_> = (0..7).map(|row| all.ending_in(RowIndex(row)).map(|t| t.0)).collect();
        assert_eq!(ending, [None, Some(0), Some(1), None, None, Some(2), None]);
    }
}
