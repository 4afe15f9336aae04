//! What was recorded and what each model made of it, start by start.

use super::rollout::{Trajectory, axis_label, checked_length, scale_around};
use crate::chart::{Axis, Chart, Colour, GridCell, Scale};
use crate::number::{duration, time_unit};
use crate::{Figure, ReportError};

/// Points of each small plot.
const POINTS: usize = 700;
const HEIGHT: f64 = 120.0;

/// Small plots of one sensor: a row for each start, what was recorded in the first column, one model in each other.
/// All have the same axes.
#[derive(Debug, Clone, PartialEq)]
pub struct RolloutGrid {
    /// The sensor.
    pub sensor: String,
    /// Its physical unit: "kPa".
    pub unit: Option<String>,
    /// Names of the models, in the order of their columns.
    pub models: Vec<String>,
    /// One row for each start.
    pub rows: Vec<RolloutRow>,
}

/// One start of a [`RolloutGrid`].
#[derive(Debug, Clone, PartialEq)]
pub struct RolloutRow {
    /// What the row is called: "start 1".
    pub label: String,
    /// What the plant did.
    pub truth: Trajectory,
    /// What each model did from there; `None` where it was not rolled out from this start.
    pub rollouts: Vec<Option<Trajectory>>,
}

impl RolloutGrid {
    /// Draws the figure. The vertical axis holds what was recorded and, within one height of it on either side,
    /// the rollouts.
    ///
    /// # Errors
    ///
    /// There is no trajectory with values, or a sample period is not positive.
    pub fn figure(&self) -> Result<Figure, ReportError> {
        let title = format!("{}: recorded, and rolled out from the same starts", self.sensor);
        let truths = || self.rows.iter().map(|row| &row.truth);
        let rollouts = || self.rows.iter().flat_map(|row| row.rollouts.iter().flatten());
        let length = checked_length(truths().chain(rollouts()), &title)?;
        let (unit_secs, unit_name) = time_unit(length);
        let scale = scale_around(truths(), rollouts());
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

    fn heading(&self, column: usize) -> String {
        match column {
            0 => {
                self.unit.as_ref().map_or("recorded".to_owned(), |unit| format!("recorded, {unit}"))
            }
            _ => self.models.get(column - 1).cloned().unwrap_or_default(),
        }
    }
}

/// One curve alone; what was recorded stands in the first column, in ink.
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
