//! Axes of a sensitivity figure, and its description.

use calib_stats::Summary;

use super::{NRMSE, Sensitivity};
use crate::chart::{Axis, Scale, extent};

impl Sensitivity {
    /// The values as numbers, if they can stand on a logarithmic axis: none is a name, and none is 0, such as the step size
    /// that leaves an agent as it was pre-trained.
    fn numbers(&self) -> Option<Vec<f64>> {
        self.values.iter().map(|value| value.as_number().filter(|number| *number != 0.0)).collect()
    }

    /// Horizontal position of each value: the number itself, or else its place in the grid.
    pub(super) fn positions(&self) -> Vec<f64> {
        self.numbers().unwrap_or_else(|| (0..self.values.len()).map(|place| place as f64).collect())
    }

    pub(super) fn horizontal_axis(&self, positions: &[f64]) -> Axis {
        let scale = if self.numbers().is_some() {
            Scale::log_around(positions)
        } else {
            Scale::names(self.values.iter().map(ToString::to_string).collect())
        };
        Axis { label: self.field.clone(), scale }
    }

    /// Mean errors that can be drawn, and their intervals.
    fn drawn_summaries(&self) -> impl Iterator<Item = &Summary> + Clone {
        let summaries = self.errors.iter().flat_map(|curve| curve.summaries.iter().flatten());
        summaries.filter(|summary| summary.mean.is_finite())
    }

    /// The least and the greatest end of an interval that the plot has room for. A single wild interval must not press all curves
    /// flat: it may reach one spread beyond the means, and not so far towards zero that a logarithmic axis would show little else.
    fn room_of_intervals(&self) -> Option<(f64, f64)> {
        let means: Vec<f64> = self.drawn_summaries().map(|summary| summary.mean).collect();
        let (lowest, highest) = extent(&means)?;
        let spread = highest - lowest;
        let floor = if lowest > 0.0 { 0.5 * lowest } else { f64::NEG_INFINITY };
        Some(((lowest - spread).max(floor), highest + spread))
    }

    /// Whether intervals reach farther than the plot.
    pub(crate) fn cuts_intervals(&self) -> bool {
        let Some((least, greatest)) = self.room_of_intervals() else { return false };
        let mut ends = self.drawn_summaries().filter_map(|summary| summary.interval);
        ends.any(|ends| ends.low < least || ends.high > greatest)
    }

    pub(super) fn error_axis(&self) -> Axis {
        let mut values: Vec<f64> = self.drawn_summaries().map(|summary| summary.mean).collect();
        if let Some((least, greatest)) = self.room_of_intervals() {
            let ends = self.drawn_summaries().filter_map(|summary| summary.interval);
            values.extend(ends.flat_map(|ends| [ends.low.max(least), ends.high.min(greatest)]));
        }
        let scale = Scale::around(&values);
        let spacing = if scale.is_log() { " (log scale)" } else { "" };
        Axis { label: format!("mean {NRMSE}{spacing}"), scale }
    }

    pub(super) fn rank_axis(&self) -> Axis {
        // A slice of a grid has the ranks of all of it.
        let worst = self.worst_ranks.iter().flat_map(|curve| &curve.worst_ranks).copied().max();
        let scale = Scale::ranks(worst.unwrap_or(0).max(self.values.len()));
        Axis { label: "worst rank (1 = best)".to_owned(), scale }
    }

    pub(super) fn description(&self) -> String {
        let Self { sensor, field, .. } = self;
        if self.errors.is_empty() {
            return format!("Worst rank of each {field} in each calibration model, for {sensor}.");
        }
        let right = if self.worst_ranks.is_empty() {
            ""
        } else {
            ", and on the right axis the worst rank in each calibration model; compare shapes and order, not heights"
        };
        format!("Mean {NRMSE} of {sensor} for each {field}{right}.")
    }
}
