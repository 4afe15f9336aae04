//! The sections of sensitivity curves and of rollouts.

use std::fmt::Write;

use calib_core::count;
use maud::{Markup, html};

use super::figure::{Drawn, Numbers, still};
use super::{
    document::{Section, SectionEntry},
    several,
    text::prose,
};
use crate::chart::Detail;
use crate::figures::NRMSE;
use crate::{
    Cell, Chart, ErrorSource, Report, ReportError, RolloutFigure, Samples, Sensitivity, Table,
    Trajectory,
};

/// Rows of a rollout's data table. Copying gives every drawn point.
const ROLLOUT_ROWS: usize = 40;

/// Caption of small plots of rollouts.
const GRID_CAPTION: &str = "Plots of a sensor have the same axes. The first of each start is what the plant did; the others are rollouts of models from there.";

/// Most dense curves that can share a plot without hiding each other.
const MANY_CURVES: usize = 3;

/// Trajectory values that a page holds in full, some 2.7 bytes each. Further
/// trajectories are thinned to the drawn points.
pub(super) const WHOLE_VALUES: usize = 600_000;

/// Returns the section of sensitivity curves.
pub(super) fn sensitivities(report: &Report) -> Result<Section, ReportError> {
    let mut figures = Vec::new();
    let mut parts = Vec::new();
    let captions: Vec<String> = report.sensitivities.iter().map(Sensitivity::caption).collect();
    let common = shared(&captions);
    for (index, (sensitivity, caption)) in report.sensitivities.iter().zip(&captions).enumerate() {
        let caption = if caption == common { "" } else { caption.as_str() };
        let id = format!("sensitivity-{index}");
        if sensitivity.is_of_several() {
            figures.push(several::markup(
                sensitivity,
                &id,
                caption,
                &sensitivity_table(sensitivity),
            )?);
            parts.push(SectionEntry { id, title: sensitivity.sensor.clone() });
            continue;
        }
        let figure = sensitivity.figure()?;
        let drawn = Drawn {
            chart: figure.chart(),
            id: &id,
            caption,
            table: &sensitivity_table(sensitivity),
            numbers: Numbers::All,
            shown: shown(figure.chart()),
            details: &[],
        };
        figures.push(drawn.markup());
        parts.push(SectionEntry { id, title: sensitivity.sensor.clone() });
    }
    let two_axes = report.sensitivities.iter().any(Sensitivity::has_two_axes);
    let body = html! {
        p.lead {
            "How much the choice matters, and whether "
            @if report.has_models() { "the models rank" } @else { "the log ranks" }
            " settings as held-out data does. "
            @if two_axes {
                "The two vertical axes measure different things: compare curves by shape and order, not by height."
            }
        }
        (common_caption(common))
        (help(report))
        @for figure in figures { (figure) }
    };
    Ok(Section { id: "sensitivity", title: "Sensitivity curves", parts, body })
}

/// Returns the caption that all figures share; empty if captions differ.
fn shared(captions: &[String]) -> &str {
    match captions {
        [first, others @ ..] if !others.is_empty() && others.iter().all(|other| other == first) => {
            first
        }
        _ => "",
    }
}

/// Returns a caption that applies to all figures of a section, for one paragraph above them.
pub(super) fn common_caption(caption: &str) -> Markup {
    html! { @if !caption.is_empty() { p.lead.common { (prose(caption)) } } }
}

/// Returns the instructions for a chart's tools.
fn help(report: &Report) -> Markup {
    html! {
        details.help.sampled {
            summary { "Using the charts" }
            ul {
                li { "Point at a chart to read its values. A click on a name hides or shows a curve." }
                li {
                    "Drag over a part to zoom in, or hold " kbd { "Ctrl" } " and turn the wheel; a double click shows all again. "
                    @if report.has_models() { "A zoomed rollout is drawn with every recorded step." }
                }
                li {
                    "By keyboard: " kbd { "Tab" } " to a chart, " kbd { "←" } " " kbd { "→" } " read values, "
                    kbd { "↑" } " " kbd { "↓" } " change the curve, " kbd { "+" } " " kbd { "−" } " zoom, "
                    kbd { "Shift" } " with " kbd { "←" } " " kbd { "→" } " moves, " kbd { "0" } " shows all."
                }
                li { "SVG, PNG and CSV save a chart as you see it, or its numbers. Nothing is sent anywhere." }
            }
        }
    }
}

/// Returns the section of rollouts.
pub(super) fn rollouts(report: &Report) -> Result<Section, ReportError> {
    let mut figures = Vec::new();
    let mut parts = Vec::new();
    let mut left = WHOLE_VALUES;
    let details: Vec<Vec<Detail<'_>>> = report
        .rollouts
        .iter()
        .map(|rollout| {
            let details = rollout.details();
            match left.checked_sub(details.iter().map(|detail| detail.values.len()).sum()) {
                Some(rest) => {
                    left = rest;
                    details
                }
                None => Vec::new(),
            }
        })
        .collect();
    let captions: Vec<String> = report
        .rollouts
        .iter()
        .zip(&details)
        .map(|(rollout, details)| rollout.caption(!details.is_empty()))
        .collect();
    let common = shared(&captions);
    for (index, ((rollout, details), caption)) in
        report.rollouts.iter().zip(&details).zip(&captions).enumerate()
    {
        let caption = if caption == common { "" } else { caption.as_str() };
        let figure = rollout.figure()?;
        let id = format!("rollout-{index}");
        let drawn = Drawn {
            chart: figure.chart(),
            id: &id,
            caption,
            table: &rollout_table(rollout),
            numbers: Numbers::Sampled,
            shown: shown(figure.chart()),
            details,
        };
        figures.push(drawn.markup());
        parts.push(SectionEntry { id, title: rollout.sensor.clone() });
    }
    let mut stills = Vec::new();
    for (index, grid) in report.rollout_grids.iter().enumerate() {
        let id = format!("grid-{index}");
        stills.push(still(&grid.figure()?, &id));
        parts.push(SectionEntry { id, title: format!("{}, start by start", grid.sensor) });
    }
    let body = html! {
        p.lead {
            "What the models believe the plant could do, over what it did. A rollout need not follow the true \
             trajectory in time; it should move in the same range, with the same shapes and rhythm."
        }
        (common_caption(common))
        @for figure in figures { (figure) }
        @if !stills.is_empty() { (common_caption(GRID_CAPTION)) }
        @for still in stills { (still) }
    };
    Ok(Section { id: "rollouts", title: "Rollouts", parts, body })
}

/// Returns the number of curves that are on at first: all, or the truth
/// and one rollout if curves are dense and many.
fn shown(chart: &Chart) -> usize {
    let dense = chart.series.iter().all(|series| series.marker.is_none());
    if dense && chart.series.len() > MANY_CURVES { 2 } else { chart.series.len() }
}

impl Sensitivity {
    fn caption(&self) -> String {
        let field = if self.is_of_several() { "setting" } else { self.field.as_str() };
        if self.errors.is_empty() {
            return format!(
                "Worst rank of each {field} of the grid over the ensemble members of each calibration model. No data was held out to compare it with."
            );
        }
        let mut caption = format!(
            "Mean {NRMSE} of the predictions over {}, with 95 % t-intervals, for each {field} of the grid. \
             {NRMSE} is the error divided by the standard deviation of the return in the training range: 1 is that of predicting \
             the mean.",
            self.samples(),
        );
        if self.errors.iter().any(|curve| curve.source == ErrorSource::Evidence) {
            caption.push_str(if self.worst_ranks.is_empty() {
                " What decides is the geometric mean over the windows of the replayed log."
            } else {
                " Of a model: the geometric mean over the training runs that it chose by."
            });
        }
        if self.cuts_intervals() {
            caption.push_str(" Intervals that leave a plot are cut off at its edge, so that differences between settings can be seen.");
        }
        if !self.worst_ranks.is_empty() {
            caption.push_str(
                " Dashed and dotted, on the right axis: the worst rank over the ensemble members of each calibration model.",
            );
        }
        caption
    }

    /// Returns the samples that means are over: "windows".
    fn samples(&self) -> &'static str {
        let counted = self.errors.iter().filter(|curve| curve.source != ErrorSource::Evidence);
        match counted.clone().filter(|curve| curve.over == Samples::Runs).count() {
            0 => "windows",
            all if all == counted.count() => "runs",
            _ => "windows, or runs where there is one window",
        }
    }
}

impl RolloutFigure {
    fn caption(&self, whole: bool) -> String {
        let longest = self.trajectories().map(|t| t.values.len()).max().unwrap_or(0);
        let mut caption = format!("{} steps.", count(longest as u64));
        if longest > crate::MAX_POINTS {
            caption.push_str(if whole {
                " Thinned so that every peak stays visible; zoom in to see every step."
            } else {
                " Thinned so that every peak stays visible."
            });
        }
        let runaways = self.runaways();
        if !runaways.is_empty() {
            // Writing to a String cannot fail.
            let _ = write!(
                caption,
                " Leaving the plot, far from what was recorded: {}.",
                runaways.join(", ")
            );
        }
        if self.trajectories().count() > MANY_CURVES {
            caption.push_str(" Switch further rollouts on by their names.");
        }
        caption
    }
}

fn sensitivity_table(sensitivity: &Sensitivity) -> Table {
    let mut columns = vec![sensitivity.field.clone()];
    for curve in &sensitivity.errors {
        columns.push(format!("{}: mean {NRMSE}", curve.label));
        columns.extend(["95 % from", "to", curve.over.name(), "diverged"].map(ToOwned::to_owned));
    }
    columns
        .extend(sensitivity.worst_ranks.iter().map(|curve| format!("{}: worst rank", curve.label)));
    Table {
        title: format!("Data of {}, {}", sensitivity.sensor, sensitivity.field),
        columns,
        rows: (0..sensitivity.values.len())
            .map(|place: usize| {
                let mut row = vec![Cell::Setting(sensitivity.values[place].clone())];
                for curve in &sensitivity.errors {
                    match &curve.summaries[place] {
                        None => row.extend([const { Cell::Missing }; 5]),
                        Some(summary) => {
                            row.push(Cell::Number(summary.mean));
                            row.push(summary.interval.map(|interval| interval.low).into());
                            row.push(summary.interval.map(|interval| interval.high).into());
                            row.push(Cell::Count(summary.runs as u64));
                            row.push(Cell::Count(summary.diverged as u64));
                        }
                    }
                }
                row.extend(
                    sensitivity
                        .worst_ranks
                        .iter()
                        .map(|curve| Cell::Count(curve.worst_ranks[place] as u64)),
                );
                row
            })
            .collect(),
        ..Table::default()
    }
}

/// Returns the values of all trajectories at evenly spaced times of the longest one.
fn rollout_table(rollout: &RolloutFigure) -> Table {
    let all: Vec<&Trajectory> = rollout.trajectories().collect();
    let length = all.iter().map(|t| t.secs()).fold(0.0, f64::max);
    let longest = all.iter().map(|t| t.values.len()).max().unwrap_or(0);
    let rows = longest.min(ROLLOUT_ROWS);
    let last = rows.saturating_sub(1).max(1);
    let columns = std::iter::once("Seconds since start".to_owned())
        .chain(all.iter().map(|t| t.label.clone()));
    Table {
        title: format!("Data of {}, sampled", rollout.sensor),
        columns: columns.collect(),
        rows: (0..rows)
            .map(|place: usize| sampled_row(&all, length * place as f64 / last as f64))
            .collect(),
        ..Table::default()
    }
}

/// Returns a row: a time after the start, and the value of each trajectory then.
fn sampled_row(all: &[&Trajectory], secs: f64) -> Vec<Cell> {
    std::iter::once(Cell::Number(secs))
        .chain(all.iter().map(|t| {
            let index = (secs / t.period_secs).round() as usize;
            t.values
                .get(index)
                .filter(|value| !value.is_nan())
                .map_or(Cell::Missing, |&value| Cell::Number(value))
        }))
        .collect()
}
