//! Recorded values beside the rollouts of each model, one row per start state.

use super::rollout::{Trajectory, axis_label, checked_length, scale_around};
use crate::chart::{Axis, Chart, Colour, GridCell, Scale};
use crate::duration::{duration, time_unit};
use crate::{Figure, ReportError};

/// Points per small plot.
const POINTS: usize = 700;
const HEIGHT: f64 = 120.0;

/// Small plots of one sensor: one row per start state, the record in the first column, and one column per model.
/// All plots have the same axes.
#[derive(Debug, Clone, PartialEq)]
pub struct RolloutGrid {
    /// The sensor.
    pub sensor: String,
    /// Its physical unit: "kPa".
    pub unit: Option<String>,
    /// Names of the models, in the order of their columns.
    pub models: Vec<String>,
    /// One row per start state.
    pub rows: Vec<RolloutRow>,
}

/// One start state of a [`RolloutGrid`].
#[derive(Debug, Clone, PartialEq)]
pub struct RolloutRow {
    /// Name of the row: "start 1".
    pub label: String,
    /// Recorded trajectory.
    pub truth: Trajectory,
    /// Rollout of each model from there; `None` for models without a rollout from this start state.
    pub rollouts: Vec<Option<Trajectory>>,
}

impl RolloutGrid {
    /// Draws the figure. The vertical axis holds the record, and the rollouts
    /// within one height of the record on either side.
    ///
    /// # Errors
    ///
    /// If no trajectory has values, or a sample period is not positive.
    pub fn figure(&self) -> Result<Figure, ReportError> {
        let title = format!("{}: recorded, and rolled out from the same starts", self.sensor);
        let length = checked_length(self.truths().chain(self.rollouts()), &title)?;
        let (unit_secs, unit_name) = time_unit(length);
        let scale = scale_around(self.truths(), self.rollouts());
        let rows = self
            .rows
            .iter()
            .enumerate()
            .map(|(number, row)| {
                let is_last = number + 1 == self.rows.len();
                let time =
                    if is_last { format!("time since start ({unit_name})") } else { String::new() };
                let x = Axis { label: time, scale: Scale::linear(0.0, length / unit_secs) };
                let all = std::iter::once(Some(&row.truth))
                    .chain(row.rollouts.iter().map(Option::as_ref));
                all.enumerate()
                    .map(|(column, trajectory)| {
                        let name = if column == 0 { row.label.clone() } else { String::new() };
                        let left = Axis { label: name, scale: scale.clone() };
                        GridCell {
                            heading: (number == 0).then(|| self.heading(column)),
                            chart: trajectory.map(|trajectory| {
                                cell_chart(trajectory, column, x.clone(), left, unit_secs)
                            }),
                        }
                    })
                    .collect()
            })
            .collect();
        let label = axis_label(&self.sensor, self.unit.as_deref());
        let description = format!(
            "{label} over {} from {} starts: what was recorded beside {}.",
            duration(length),
            self.rows.len(),
            self.models.join(", ")
        );
        let x = Axis { label: String::new(), scale: Scale::linear(0.0, length / unit_secs) };
        let left = Axis { label, scale: scale.clone() };
        let head = Chart { title, description, ..Chart::of(x, left, Vec::new()) };
        Ok(Figure::with_grid(head, rows, HEIGHT))
    }

    fn truths(&self) -> impl Iterator<Item = &Trajectory> + Clone {
        self.rows.iter().map(|row| &row.truth)
    }

    fn rollouts(&self) -> impl Iterator<Item = &Trajectory> {
        self.rows.iter().flat_map(|row| row.rollouts.iter().flatten())
    }

    fn heading(&self, column: usize) -> String {
        match column {
            0 => {
                self.unit.as_ref().map_or("recorded".to_owned(), |unit| format!("recorded, {unit}"))
            }
            _ => self.models.get(column - 1).cloned().unwrap_or_default(),
        }
    }
}

/// Returns the chart of one curve. The record stands in the first column, in the colour of text.
fn cell_chart(
    trajectory: &Trajectory,
    column: usize,
    x: Axis,
    left: Axis,
    unit_secs: f64,
) -> Chart {
    let colour = if column == 0 { Colour::Ink } else { Colour::Curve(column) };
    Chart::of(x, left, vec![trajectory.series(unit_secs, POINTS, colour, 1.0)])
}
