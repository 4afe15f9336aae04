use calib_core::{RowIndex, Seed, States, TransitionIndex, Transitions};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    RequestedStart, RolloutError, StartSource,
    requested_start::{deployment_rows, draw, recorded_rows},
};

/// A recorded row as a start state, and the requested one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StartRow {
    /// The recorded row.
    pub row: RowIndex,
    /// The requested state.
    pub wanted: RequestedStart,
    /// The distance from the requested state to this row, if the row replaces it.
    pub replaced: Option<f32>,
}

/// Returns `count` start rows for rollouts of a parametric model, which may start anywhere in its data: as
/// [`start_states`](crate::start_states) of a member that lacks nothing.
///
/// Start state `r` depends only on `seed` and `r`. `states` are those of the data. Nearest ones are found by a
/// comparison with each of them; ties go to the first.
///
/// # Errors
/// If the source has no rows, names rows that do not exist, or finds nothing.
pub fn start_rows(
    states: &States,
    transitions: &Transitions,
    source: StartSource<'_>,
    count: usize,
    seed: Seed,
) -> Result<Vec<StartRow>, RolloutError> {
    if let StartSource::Nearest { states: deployment } = source {
        let rows = deployment_rows(deployment, count, seed)?;
        return Ok(rows.into_iter().map(|row| nearest(states, deployment, row)).collect());
    }
    if let Some(rows) = recorded_rows(source, transitions, states.rows(), count, seed)? {
        return Ok(rows.into_iter().map(recorded).collect());
    }
    let all = transitions.len();
    if all == 0 {
        return Err(RolloutError::NoTransitions);
    }
    let drawn = (0..count).map(|r| TransitionIndex::new(draw(seed, r, all)));
    Ok(drawn.map(|transition| recorded(transitions.next(transition))).collect())
}

/// Returns the requested row itself.
fn recorded(row: RowIndex) -> StartRow {
    StartRow { row, wanted: RequestedStart::Recorded(row), replaced: None }
}

/// Returns the recorded row nearest to one of the deployment.
fn nearest(states: &States, deployment: &States, wanted: RowIndex) -> StartRow {
    let sought = deployment.row(wanted.get());
    let (row, square) = (0..states.rows())
        .map(|row| {
            let pairs = states.row(row).iter().zip(sought);
            let squares = pairs.map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2));
            (row, squares.sum::<f64>())
        })
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .expect("data has rows");
    StartRow {
        row: RowIndex::new(row),
        wanted: RequestedStart::Deployment(wanted),
        replaced: Some(square.sqrt() as f32),
    }
}

#[cfg(test)]
mod tests {
    use calib_core::{Segments, Timestamp};

    use super::*;
    use crate::Absent;

    fn data() -> (States, Transitions) {
        let states = States::new((0..20_u8).map(f32::from).collect(), 20, 1).expect("valid");
        (states, Transitions::new(Segments::from_lengths([1, 9, 10]).expect("valid")))
    }

    /// Returns four start rows.
    fn rows(source: StartSource<'_>) -> Vec<u32> {
        let (states, transitions) = data();
        let starts = start_rows(&states, &transitions, source, 4, Seed::new(2)).expect("valid");
        starts.iter().map(|start| start.row.0).collect()
    }

    #[test]
    fn every_source_gives_recorded_rows() {
        let (states, transitions) = data();
        let random = rows(StartSource::Random);
        assert!(
            random.iter().all(|&row| row > 1 && row != 10),
            "rows that follow others: {random:?}"
        );

        let listed = [RowIndex(0), RowIndex(7), RowIndex(10)];
        let listed = StartSource::Rows { rows: &listed, absent: Absent::External };
        assert_eq!(rows(listed), [0, 7, 10, 0]);
        // January 1970 until row 12, then February.
        let timestamps: Vec<Timestamp> =
            (0..20).map(|row| Timestamp::from_micros((732 + row) * 3_600_000_000)).collect();
        let window = Some(8);
        for (before, expected) in [(None, [19, 15, 17, 13]), (Some(timestamps[12]), [11, 6, 8, 4])]
        {
            let recent = StartSource::Recent { timestamps: &timestamps, before, window };
            assert_eq!(rows(recent), expected);
        }
        let month = StartSource::CalendarMonth { timestamps: &timestamps, month: 2, before: None };
        assert!(rows(month).iter().all(|&row| row >= 12));
        let deployment = States::new(vec![4.2], 1, 1).expect("valid");
        let source = StartSource::Nearest { states: &deployment };
        let near = start_rows(&states, &transitions, source, 1, Seed::new(2)).expect("valid");
        assert_eq!(
            (near[0].row, near[0].wanted),
            (RowIndex(4), RequestedStart::Deployment(RowIndex(0)))
        );
        assert!((near[0].replaced.expect("replaced") - 0.2).abs() < 1e-6);
    }

    #[test]
    fn data_without_transitions_has_no_random_start() {
        let (states, _) = data();
        let still = Transitions::new(Segments::from_lengths([1; 20]).expect("valid"));
        let nothing = start_rows(&states, &still, StartSource::Random, 1, Seed::new(2));
        assert!(matches!(nothing, Err(RolloutError::NoTransitions)));
    }
}
