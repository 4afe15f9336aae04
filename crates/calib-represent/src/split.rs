use std::ops::Range;

use calib_core::Segments;

use crate::RepresentError;

/// The states for training a representation, and the later ones for scoring it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Split {
    /// The rows for training.
    pub training: Range<usize>,
    /// The rows for scoring.
    pub validation: Range<usize>,
}

impl Split {
    /// Splits the rows in time: the first 0.8 for training and the last 0.2 for scoring (paper:
    /// 0.8/0.2).
    ///
    /// # Errors
    /// If one part has no two successive states.
    pub fn in_time(segments: &Segments) -> Result<Self, RepresentError> {
        let rows = segments.rows();
        let border = rows * 4 / 5;
        let split = Self { training: 0..border, validation: border..rows };
        for (part, rows) in [("training", &split.training), ("validation", &split.validation)] {
            if successive(segments, rows).next().is_none() {
                return Err(RepresentError::NoPairs { part, rows: rows.len() });
            }
        }
        Ok(split)
    }
}

/// Returns the rows in `rows` whose next row is in the same segment and in `rows`.
pub(crate) fn successive<'a>(
    segments: &'a Segments,
    rows: &Range<usize>,
) -> impl Iterator<Item = usize> + use<'a> {
    let rows = rows.clone();
    segments.iter().flat_map(move |segment| {
        let end = segment.rows().end.min(rows.end);
        segment.rows().start.max(rows.start)..end.saturating_sub(1)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn later_states_are_held_back() {
        let segments = Segments::from_lengths([3, 5, 2]).expect("valid");
        let split = Split::in_time(&segments).expect("long enough");
        assert_eq!((split.training.clone(), split.validation.clone()), (0..8, 8..10));
        let [training, some] =
            [split.training, 1..5].map(|rows| successive(&segments, &rows).collect::<Vec<usize>>());
        assert_eq!(training, [0, 1, 3, 4, 5, 6]);
        assert_eq!(some, [1, 3]);
    }

    #[test]
    fn parts_without_a_pair_are_refused() {
        let segments = Segments::from_lengths([8, 1, 1]).expect("valid");
        let error = Split::in_time(&segments).expect_err("two lone states");
        assert!(error.to_string().contains("validation part of the training range (2 states)"));
    }
}
