//! The report as one self-contained HTML document.

mod charts;
mod document;
mod figure;
mod learning;
mod overview;
mod recorded;
mod several;
mod tables;
mod text;
mod verdicts;

use document::{Section, document};

use crate::{Report, ReportError};

impl Report {
    /// Returns the report as one self-contained HTML document: no network,
    /// with styles, script and figures inline.
    ///
    /// # Errors
    ///
    /// If a figure cannot be drawn; see [`Sensitivity::figure`], [`LearningCurves::figure`],
    /// [`RecordedFigure::figure`], [`RolloutFigure::figure`] and [`RolloutGrid::figure`].
    ///
    /// [`Sensitivity::figure`]: crate::Sensitivity::figure
    /// [`LearningCurves::figure`]: crate::LearningCurves::figure
    /// [`RecordedFigure::figure`]: crate::RecordedFigure::figure
    /// [`RolloutFigure::figure`]: crate::RolloutFigure::figure
    /// [`RolloutGrid::figure`]: crate::RolloutGrid::figure
    pub fn html(&self) -> Result<String, ReportError> {
        let sections = sections(self)?;
        Ok(document(&self.title, self.subtitle.as_deref(), "Skip to the verdict", &sections))
    }
}

/// Returns the sections that have content: the verdict, its evidence, then data and reproduction.
fn sections(report: &Report) -> Result<Vec<Section>, ReportError> {
    let mut sections = vec![verdicts::verdicts(report)];
    if !report.sensitivities.is_empty() {
        sections.push(charts::sensitivities(report)?);
    }
    if !report.recorded.is_empty() {
        sections.push(recorded::recorded(report)?);
    }
    if !report.rollouts.is_empty() || !report.rollout_grids.is_empty() {
        sections.push(charts::rollouts(report)?);
    }
    if !report.jumps.is_empty() || !report.tables.is_empty() {
        sections.push(tables::statistics(report));
    }
    if !report.learning.is_empty() {
        sections.push(learning::curves(report)?);
    }
    if let Some(data) = &report.data {
        sections.push(tables::data(data));
    }
    sections.push(tables::reproduction(&report.reproduction));
    Ok(sections)
}
