//! Axes of a sensitivity figure, and its description.

use calib_stats::Summary;

use super::{NRMSE, Sensitivity};
use crate::chart::{Axis, Scale, extent};

impl Sensitivity {
    /// Returns the values as numbers, if a logarithmic axis can show them: no value is a name or 0. 0 is the step size that
    /// leaves a pre-trained agent unchanged.
    fn numbers(&self) -> Option<Vec<f64>> {
        self.values.iter().map(|value| value.as_number().filter(|number| *number != 0.0)).collect()
    }

    /// Returns the horizontal position of each value: the number itself, or its place in the grid.
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

    /// Returns the summaries whose mean error is finite.
    fn drawn_summaries(&self) -> impl Iterator<Item = &Summary> + Clone {
        let summaries = self.errors.iter().flat_map(|curve| curve.summaries.iter().flatten());
        summaries.filter(|summary| summary.mean.is_finite())
    }

    /// Returns the lowest and the highest interval end that the plot has room for. Intervals reach at most one spread beyond the
    /// means, so that a single wide interval does not flatten all curves. Towards zero they end earlier, because of the
    /// logarithmic axis.
    fn room_of_intervals(&self) -> Option<(f64, f64)> {
        let means: Vec<f64> = self.drawn_summaries().map(|summary| summary.mean).collect();
        let (lowest, highest) = extent(&means)?;
        let spread = highest - lowest;
        let floor = if lowest > 0.0 { 0.5 * lowest } else { f64::NEG_INFINITY };
        Some(((lowest - spread).max(floor), highest + spread))
    }

    /// Whether an interval reaches beyond the plot.
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
        // A slice of a grid has ranks among the whole grid.
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
