//! The section of learning curves.

use maud::{Markup, html};

use super::charts::common_caption;
use super::document::{Section, SectionEntry};
use super::figure::{Drawn, Numbers};
use crate::{Cell, LearningCurves, Report, ReportError, Table};

/// With more curves than there are colours and patterns, the others are switched off at first.
const MANY_CURVES: usize = 18;

/// Rows of a data table. Copying gives every point.
const ROWS: usize = 50;

/// Returns the section. The first figure of each sensor is open, and the others are folded.
pub(super) fn curves(report: &Report) -> Result<Section, ReportError> {
    let mut sensors: Vec<(&str, Vec<Markup>)> = Vec::new();
    let mut parts = Vec::new();
    let captions: Vec<String> = report.learning.iter().map(LearningCurves::caption).collect();
    let common = usual(&captions);
    for (index, (curves, caption)) in report.learning.iter().zip(&captions).enumerate() {
        let figure = curves.figure()?;
        let id = format!("learning-{index}");
        let drawn = Drawn {
            chart: figure.chart(),
            id: &id,
            caption: if caption == common { "" } else { caption },
            table: &curves.table(),
            numbers: Numbers::Sampled,
            shown: curves.curves.len().min(MANY_CURVES),
            details: &[],
        };
        let drawn = drawn.markup();
        let own = sensors.last_mut().filter(|(sensor, _)| *sensor == curves.sensor);
        if let Some((_, figures)) = own {
            figures.push(drawn);
        } else {
            sensors.push((&curves.sensor, vec![drawn]));
            parts.push(SectionEntry { id, title: curves.sensor.clone() });
        }
    }
    let body = html! {
        p.lead {
            "How the error falls along the run, for each setting. A setting whose error still falls at the end would gain from a longer run. One whose error falls early and rises again has lost track."
        }
        (common_caption(common))
        @for (sensor, figures) in &sensors {
            @if let Some((first, others)) = figures.split_first() {
                (first)
                @if !others.is_empty() {
                    details.more {
                        summary { (sensor) " in the other environments (" (others.len()) ")" }
                        @for figure in others { (figure) }
                    }
                }
            }
        }
    };
    Ok(Section { id: "learning", title: "Learning curves", parts, body })
}

/// Returns the most common caption, if several figures have it.
/// Other figures state only what differs.
fn usual(captions: &[String]) -> &str {
    // `max_by_key` returns the last of equals, so the search runs backwards to find the first.
    let most = captions.iter().rev().max_by_key(|caption| times(captions, caption));
    most.filter(|caption| times(captions, caption) > 1).map_or("", String::as_str)
}

/// Returns how many of the captions are this one.
fn times(captions: &[String], caption: &str) -> usize {
    captions.iter().filter(|other| *other == caption).count()
}

impl LearningCurves {
    fn caption(&self) -> String {
        let points = self.curves.iter().flat_map(|curve| &curve.points);
        let runs = points.map(|(_, summary)| summary.runs).max().unwrap_or(0);
        let windows = self.curves.iter().map(|curve| curve.points.len()).max().unwrap_or(0);
        let mut caption = format!(
            "RMSE of the predictions, in normalised units, over each of {windows} equally long windows of the run; \
             mean over {runs} {}, with 95 % t-intervals.",
            if runs == 1 { "run" } else { "runs" }
        );
        let diverged: Vec<String> = self
            .curves
            .iter()
            .filter(|curve| curve.diverged().is_some())
            .map(|curve| curve.value.to_string())
            .collect();
        if !diverged.is_empty() {
            let values = diverged.join(", ");
            caption.extend([" A run of ", &values, " diverged; the curve ends there."]);
        }
        caption
    }

    fn table(&self) -> Table {
        let mut steps: Vec<usize> =
            self.curves.iter().flat_map(|curve| &curve.points).map(|&(step, _)| step).collect();
        steps.sort_unstable();
        steps.dedup();
        let every = steps.len().div_ceil(ROWS).max(1);
        let columns = std::iter::once("Step".to_owned()).chain(
            self.curves.iter().map(|curve| format!("{} = {}: RMSE", self.field, curve.value)),
        );
        Table {
            title: format!("Learning curves of {}, {}", self.sensor, self.environment),
            columns: columns.collect(),
            rows: steps.iter().step_by(every).map(|&step| self.row(step)).collect(),
            ..Table::default()
        }
    }

    /// Returns a row: a step, and the error of each curve at this step.
    fn row(&self, step: usize) -> Vec<Cell> {
        std::iter::once(Cell::Count(step as u64))
            .chain(self.curves.iter().map(|curve| {
                let point = curve.points.iter().find(|&&(at, _)| at == step);
                point.map_or(Cell::Missing, |(_, summary)| Cell::Number(summary.mean))
            }))
            .collect()
    }
}
