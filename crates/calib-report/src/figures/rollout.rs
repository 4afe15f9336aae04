//! Rollouts over the true trajectory, in physical units.

use calib_core::number;

use crate::chart::{Axis, Chart, Colour, Dash, Detail, Point, Scale, Series, Side, extent};
use crate::downsample::min_max_indices;
use crate::duration::{duration, time_unit};
use crate::{Figure, ReportError};

/// Drawn points per trajectory. Longer ones are thinned so that every peak stays visible.
pub const MAX_POINTS: usize = 2000;
/// Most curves with all their points. More curves share the points of these,
/// so that a page with many rollouts stays small.
const FULL_CURVES: usize = 4;
/// Fewest points of a curve, however many curves there are.
const MIN_POINTS: usize = 500;

/// The rollouts of one sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct RolloutFigure {
    /// The sensor.
    pub sensor: String,
    /// Its physical unit: "kPa".
    pub unit: Option<String>,
    /// Recorded trajectory of the plant, drawn beneath the rollouts.
    pub truth: Option<Trajectory>,
    /// Rollouts of the models from the same start state.
    pub rollouts: Vec<Trajectory>,
}

/// Values of one sensor at a constant rate.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// Name in the legend.
    pub label: String,
    /// Seconds between values.
    pub period_secs: f64,
    /// Values in physical units, from the start of the rollout; NaN for a missing value.
    pub values: Vec<f64>,
}

impl RolloutFigure {
    /// Draws the figure: the sensor's value against time since the start, in a unit that suits its length.
    ///
    /// # Errors
    ///
    /// If no trajectory has values, or a sample period is not positive.
    pub fn figure(&self) -> Result<Figure, ReportError> {
        let title = format!("{}: rollouts over the true trajectory", self.sensor);
        let length = checked_length(self.trajectories(), &title)?;
        let (unit_secs, unit_name) = time_unit(length);
        let curves = self.trajectories().count();
        let points = (FULL_CURVES * MAX_POINTS / curves).clamp(MIN_POINTS, MAX_POINTS);
        let truth = self.truth.iter().map(|t| t.series(unit_secs, points, Colour::Truth, 2.2));
        let rollouts = self.rollouts.iter().enumerate().map(|(index, t)| {
            // Colour 0 belongs to the held-out period in sensitivity figures, and rollouts belong to models.
            t.series(unit_secs, points, Colour::Curve(1 + index), 1.3)
        });
        let series: Vec<Series> = truth.chain(rollouts).collect();
        let scale = scale_around(self.truth.iter(), self.rollouts.iter());
        let label = axis_label(&self.sensor, self.unit.as_deref());
        let x = Axis {
            label: format!("time since start ({unit_name})"),
            scale: Scale::linear(0.0, length / unit_secs),
        };
        let description = self.description(length);
        let left = Axis { label, scale };
        let chart = Chart { title, description, ..Chart::of(x, left, series) };
        let panels = self.panels(&chart);
        Ok(Figure::with_panels(chart, panels))
    }

    /// Returns the recorded trajectory, if it is shown, then the rollouts.
    pub(crate) fn trajectories(&self) -> impl Iterator<Item = &Trajectory> {
        self.truth.iter().chain(&self.rollouts)
    }

    /// Returns the names of the rollouts that leave the plot.
    pub(crate) fn runaways(&self) -> Vec<&str> {
        let (low, high) = limits(self.truth.iter());
        self.rollouts
            .iter()
            .filter(|trajectory| trajectory.values.iter().any(|&value| value < low || value > high))
            .map(|trajectory| trajectory.label.as_str())
            .collect()
    }

    /// Describes the curves and their ranges for readers who cannot see the chart.
    fn description(&self, length: f64) -> String {
        let curves: Vec<String> = self
            .trajectories()
            .map(|trajectory| match extent(&trajectory.values) {
                Some((low, high)) => {
                    format!("{} between {} and {}", trajectory.label, number(low), number(high))
                }
                None => format!("{} without values", trajectory.label),
            })
            .collect();
        format!("{} over {} from the start: {}.", self.sensor, duration(length), curves.join("; "))
    }

    /// Returns every value of every curve, in the order and the unit of the chart.
    pub(crate) fn details(&self) -> Vec<Detail<'_>> {
        let (unit_secs, _) =
            time_unit(self.trajectories().map(Trajectory::secs).fold(0.0, f64::max));
        self.trajectories()
            .map(|trajectory| Detail {
                step: trajectory.period_secs / unit_secs,
                values: &trajectory.values,
            })
            .collect()
    }

    /// Returns one plot per rollout, over the truth: several noisy curves in one plot hide each other.
    fn panels(&self, chart: &Chart) -> Vec<Chart> {
        let (truth, rollouts) = chart.series.split_at(usize::from(self.truth.is_some()));
        let last = rollouts.len().saturating_sub(1);
        rollouts
            .iter()
            .enumerate()
            .map(|(index, rollout)| {
                let mut panel = chart.clone();
                panel.series = truth.iter().chain([rollout]).cloned().collect();
                if index != last {
                    panel.x.label.clear();
                }
                panel
            })
            .collect()
    }
}

impl Trajectory {
    /// Returns the seconds from the first value to the last.
    pub(crate) fn secs(&self) -> f64 {
        self.period_secs * self.values.len().saturating_sub(1) as f64
    }

    pub(super) fn series(
        &self,
        unit_secs: f64,
        max_points: usize,
        colour: Colour,
        width: f64,
    ) -> Series {
        let points = min_max_indices(&self.values, max_points)
            .into_iter()
            .map(|index| Point {
                x: index as f64 * self.period_secs / unit_secs,
                y: self.values[index],
                interval: None,
            })
            .collect();
        let label = self.label.clone();
        Series { label, side: Side::Left, colour, dash: Dash::Solid, width, marker: None, points }
    }
}

/// Checks all trajectories, and returns the longest time span in seconds.
pub(super) fn checked_length<'a>(
    all: impl Iterator<Item = &'a Trajectory>,
    title: &str,
) -> Result<f64, ReportError> {
    let mut longest = None;
    for trajectory in all {
        if trajectory.period_secs <= 0.0 || !trajectory.period_secs.is_finite() {
            let (trajectory, got) = (trajectory.label.clone(), trajectory.period_secs.to_string());
            return Err(ReportError::Period { trajectory, got });
        }
        if !trajectory.values.is_empty() {
            longest = Some(longest.unwrap_or(0.0_f64).max(trajectory.secs()));
        }
    }
    longest.ok_or_else(|| ReportError::Empty { figure: title.to_owned(), missing: "values" })
}

/// Returns a scale that holds the truths and the rollouts. Rollouts count only within one height of the truths on
/// either side, so that a runaway model does not flatten the plot.
pub(super) fn scale_around<'a>(
    truths: impl Iterator<Item = &'a Trajectory> + Clone,
    rollouts: impl Iterator<Item = &'a Trajectory>,
) -> Scale {
    let (low, high) = limits(truths.clone());
    let finite = truths
        .chain(rollouts)
        .flat_map(|trajectory| &trajectory.values)
        .filter(|value| value.is_finite());
    Scale::linear_around(&finite.map(|value| value.clamp(low, high)).collect::<Vec<_>>())
}

/// Returns limits at one height of the truths below and above them; infinite limits if they have no height.
fn limits<'a>(truths: impl Iterator<Item = &'a Trajectory>) -> (f64, f64) {
    let ends = truths.filter_map(|truth| extent(&truth.values));
    match ends.reduce(|(low, high), (least, most)| (low.min(least), high.max(most))) {
        Some((low, high)) if low < high => (low - (high - low), high + (high - low)),
        _ => (f64::NEG_INFINITY, f64::INFINITY),
    }
}

/// Returns the sensor with its unit, if the unit is known.
pub(super) fn axis_label(sensor: &str, unit: Option<&str>) -> String {
    unit.map_or_else(|| sensor.to_owned(), |unit| format!("{sensor} ({unit})"))
}
