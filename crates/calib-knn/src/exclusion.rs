use std::ops::Range;

use calib_core::{RowIndex, TransitionIndex, Transitions};
use serde::{Deserialize, Serialize};

/// The rule for sources that may not be neighbours of a recorded row.
///
/// The query of table row `i` is the next state `s'_i`, recorded at row `r' = next(i)`. Its nearest source is
/// its own row, at distance 0. In densely sampled logs the rows just before and after come next. So the model
/// would mostly replay the log. A source `j` at row `r_j` is forbidden if
///
/// - `self_match` is [`SelfMatch::Excluded`] and `r_j = r'`, or
/// - `theiler = W > 0` and `|r_j − r'| ≤ W` inside the same segment (Theiler 1986); this includes `r_j = r'`.
///
/// The default forbids nothing, as in the public code of the paper's group.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Exclusion {
    /// Whether a row may be its own neighbour.
    pub self_match: SelfMatch,
    /// Theiler window `W` in rows; 0 for none.
    pub theiler: u32,
}

/// Whether a row may be its own neighbour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SelfMatch {
    /// A row may be its own neighbour.
    #[default]
    Allowed,
    /// A row may not be its own neighbour.
    Excluded,
}

impl Exclusion {
    pub(crate) fn most_forbidden(self) -> u64 {
        match (self.theiler, self.self_match) {
            (0, SelfMatch::Allowed) => 0,
            (theiler, _) => 2 * u64::from(theiler) + 1,
        }
    }

    /// Returns the sources that are forbidden to the query at `row`, as a range of transitions in time order.
    pub fn forbidden(&self, transitions: &Transitions, row: RowIndex) -> Range<u32> {
        if self.theiler == 0 && self.self_match == SelfMatch::Allowed {
            return 0..0;
        }
        let segments = transitions.segments();
        let Some(position) = segments.position_of(row.get()) else {
            return 0..0;
        };
        let segment = segments.as_slice()[position];
        // The last row of a segment is not a source.
        let last = segment.end - 1;
        let first = row.0.saturating_sub(self.theiler).max(segment.start);
        let end = row.0.saturating_add(self.theiler).saturating_add(1).min(last);
        match transitions.starting_at(RowIndex(first)) {
            Some(TransitionIndex(start)) => start..start + end.saturating_sub(first),
            None => 0..0,
        }
    }
}

#[cfg(test)]
mod tests {
    use calib_core::Segments;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_range_is_the_definition(
            lengths in proptest::collection::vec(1_usize..8, 1..6),
            theiler in 0_u32..9,
            excluded: bool,
        ) {
            let transitions = Transitions::new(Segments::from_lengths(lengths).expect("valid"));
            let self_match = if excluded { SelfMatch::Excluded } else { SelfMatch::Allowed };
            let exclusion = Exclusion { self_match, theiler };
            let segments = transitions.segments();
            for row in 0..segments.rows() {
                let forbidden = exclusion.forbidden(&transitions, RowIndex::new(row));
                prop_assert!(forbidden.len() as u64 <= exclusion.most_forbidden());
                for j in 0..transitions.len() {
                    let source = transitions.source(TransitionIndex::new(j)).get();
                    let near = theiler > 0
                        && segments.position_of(source) == segments.position_of(row)
                        && source.abs_diff(row) <= theiler as usize;
                    prop_assert_eq!(
                        forbidden.contains(&(j as u32)),
                        near || (excluded && source == row)
                    );
                }
            }
        }
    }
}
