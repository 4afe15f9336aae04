//! Rollouts over the true trajectory, in physical units.

use crate::chart::{Axis, Chart, Colour, Dash, Point, Scale, Series, Side};
use crate::downsample::min_max_indices;
use crate::number::time_unit;
use crate::{Figure, ReportError};

/// Points drawn for each trajectory; longer ones are thinned so that every peak stays visible.
pub const MAX_POINTS: usize = 2000;
/// Curves that get all their points; if there are more, they share what these would have had,
/// so that a page with many rollouts stays small.
const FULL_CURVES: usize = 4;
/// Points of a curve, however many there are.
const MIN_POINTS: usize = 500;

/// One rollout figure, for one sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct RolloutFigure {
    /// The sensor.
    pub sensor: String,
    /// Its physical unit: "kPa".
    pub unit: Option<String>,
    /// What the plant did; drawn beneath the rollouts.
    pub truth: Option<Trajectory>,
    /// What the models did from the same start.
    pub rollouts: Vec<Trajectory>,
}

/// Values of one sensor at a steady rate.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// Name in the legend.
    pub label: String,
    /// Seconds from one value to the next.
    pub period_secs: f64,
    /// Values in physical units, from the start of the rollout; NaN where there is none.
    pub values: Vec<f64>,
}

impl RolloutFigure {
    /// Draws the figure: time since the start, in the unit that suits its length, against the sensor's value.
    ///
    /// # Errors
    ///
    /// There is no trajectory with values, or a sample period is not positive.
    pub fn figure(&self) -> Result<Figure, ReportError> {
        let title = format!("{}: rollouts over the true trajectory", self.sensor);
        let all = || self.truth.iter().chain(&self.rollouts);
        for trajectory in all() {
            if trajectory.period_secs <= 0.0 || !trajectory.period_secs.is_finite() {
                let trajectory_label = trajectory.label.clone();
                let got = trajectory.period_secs.to_string();
                return Err(ReportError::Period { trajectory: trajectory_label, got });
            }
        }
        let length = all()
            .map(|t| t.period_secs * t.values.len().saturating_sub(1) as f64)
            .fold(0.0, f64::max);
        if all().all(|trajectory| trajectory.values.is_empty()) {
            return Err(ReportError::Empty { figure: title, missing: "values" });
        }

        let (unit_secs, unit_name) = time_unit(length);
        let curves = all().count();
        let points = (FULL_CURVES * MAX_POINTS / curves).clamp(MIN_POINTS, MAX_POINTS);
        let truth = self.truth.iter().map(|t| t.series(unit_secs, points, Colour::Truth, 2.2));
        let rollouts = self.rollouts.iter().enumerate().map(|(index, t)| {
            // Colour 0 is Online's in the sensitivity figures; rollouts are of calibration models.
            t.series(unit_secs, points, Colour::Curve(1 + index), 1.3)
        });
        let series: Vec<Series> = truth.chain(rollouts).collect();
        let values: Vec<f64> = series.iter().flat_map(|s| s.points.iter().map(|p| p.y)).collect();
        let scale = Scale::linear_around(&values);
        let label = match &self.unit {
            Some(unit) => format!("{} ({unit})", self.sensor),
            None => format!("{} (physical unit)", self.sensor),
        };
        let chart = Chart {
            description: format!(
                "{} over {} from the start: {}.",
                self.sensor,
                crate::number::duration(length),
                series.iter().map(|s| s.label.as_str()).collect::<Vec<_>>().join(", "),
            ),
            title,
            x: Axis {
                label: format!("time since start ({unit_name})"),
                scale: Scale::linear(0.0, length / unit_secs),
            },
            left: Axis { label, scale },
            right: None,
            series,
            rules: Vec::new(),
        };
        let panels = self.panels(&chart);
        Ok(Figure::with_panels(chart, panels))
    }

    /// One plot for each rollout, over the truth: several noisy curves in one plot hide each other.
    fn panels(&self, chart: &Chart) -> Vec<Chart> {
        let (truth, rollouts) = chart.series.split_at(usize::from(self.truth.is_some()));
        let last = rollouts.len().saturating_sub(1);
        let panel = |(index, rollout): (usize, &Series)| {
            let mut panel = chart.clone();
            panel.series = truth.iter().chain([rollout]).cloned().collect();
            if index != last {
                panel.x.label.clear();
            }
            panel
        };
        rollouts.iter().enumerate().map(panel).collect()
    }
}

impl Trajectory {
    fn series(&self, unit_secs: f64, max_points: usize, colour: Colour, width: f64) -> Series {
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
