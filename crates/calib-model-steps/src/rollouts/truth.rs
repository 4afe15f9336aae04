//! The record after the requested start state of a rollout.

use std::ops::Range;

use calib_core::{Frames, RowIndex, Timestamp};
use calib_model::RequestedStart;

/// The data in which true trajectories are found.
#[derive(Clone, Copy)]
pub(crate) struct Record<'a> {
    /// The frames that the model was built from.
    pub(crate) model: &'a Frames,
    /// The deployment, if start states are taken from it.
    pub(crate) deployment: Option<&'a Frames>,
}

/// A true trajectory: recorded rows, up to the end of their segment.
pub(crate) struct Truth<'a> {
    frames: &'a Frames,
    rows: Range<usize>,
}

impl<'a> Record<'a> {
    /// Returns the record from `wanted` on, for at most `steps` steps. It is empty if `wanted` is in a deployment
    /// that is not available.
    pub(crate) fn after(&self, wanted: RequestedStart, steps: usize) -> Truth<'a> {
        let Some((frames, row)) = self.place(wanted) else {
            return Truth { frames: self.model, rows: 0..0 };
        };
        let row = row.get();
        let segments = frames.segments();
        let end = segments
            .position_of(row)
            .map_or(row, |position| segments.as_slice()[position].end as usize);
        Truth { frames, rows: row..end.min(row + steps + 1) }
    }

    /// Returns the time of `wanted`, by which models of different data identify it.
    pub(crate) fn time(&self, wanted: RequestedStart) -> Option<Timestamp> {
        let (frames, row) = self.place(wanted)?;
        Some(frames.timestamps()[row.get()])
    }

    fn place(&self, wanted: RequestedStart) -> Option<(&'a Frames, RowIndex)> {
        match wanted {
            RequestedStart::Recorded(row) => Some((self.model, row)),
            RequestedStart::Deployment(row) => Some((self.deployment?, row)),
        }
    }
}

impl Truth<'_> {
    /// Returns its number of states, one more than steps.
    pub(crate) fn len(&self) -> usize {
        self.rows.len()
    }

    /// Returns one column, normalised.
    pub(crate) fn values(&self, column: usize) -> impl Iterator<Item = f32> {
        self.rows.clone().map(move |row| self.frames.states().row(row)[column])
    }
}

/// Returns the requested row, in the data that it belongs to.
pub(crate) fn row(wanted: RequestedStart) -> RowIndex {
    match wanted {
        RequestedStart::Recorded(row) | RequestedStart::Deployment(row) => row,
    }
}

#[cfg(test)]
mod tests {
    use calib_core::{Segments, States};

    use super::*;

    fn frames(first: f32) -> Frames {
        let times = (0..6).map(Timestamp::from_micros).collect();
        let states = States::new((0..6_u8).map(|row| first + f32::from(row)).collect(), 6, 1);
        let segments = Segments::from_lengths([4, 2]).expect("valid");
        Frames::new(times, segments, states.expect("finite")).expect("valid")
    }

    fn values(record: Record<'_>, wanted: RequestedStart, steps: usize) -> Vec<f32> {
        record.after(wanted, steps).values(0).collect()
    }

    #[test]
    fn a_true_trajectory_ends_with_its_segment() {
        let model = frames(0.0);
        let deployment = frames(10.0);
        let record = Record { model: &model, deployment: Some(&deployment) };
        assert_eq!(values(record, RequestedStart::Recorded(RowIndex(1)), 1), [1.0, 2.0]);
        assert_eq!(values(record, RequestedStart::Recorded(RowIndex(1)), 9), [1.0, 2.0, 3.0]);
        assert_eq!(values(record, RequestedStart::Deployment(RowIndex(4)), 9), [14.0, 15.0]);
        let none = Record { model: &model, deployment: None };
        assert_eq!(none.after(RequestedStart::Deployment(RowIndex(4)), 9).len(), 0);
        assert_eq!(none.time(RequestedStart::Deployment(RowIndex(4))), None);
        assert_eq!(
            none.time(RequestedStart::Recorded(RowIndex(4))),
            Some(Timestamp::from_micros(4))
        );
    }
}
