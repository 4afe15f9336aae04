//! Figures of the page: the chart, its legend as buttons, and its numbers as a table.

use std::fmt::Write;

use maud::{Markup, PreEscaped, html};

use super::tables::rows;
use crate::chart::{Key, LegendPlace, chart_data, draw, keys, sample_svg, svg};
use crate::{Cell, Chart, Report, ReportError, RolloutFigure, Sensitivity, Table, Trajectory};

/// Rows of a rollout's data table; copying gives every point drawn.
const ROLLOUT_ROWS: usize = 40;

/// More dense curves than this hide each other.
const MANY_CURVES: usize = 3;

/// The section of sensitivity curves.
pub(super) fn sensitivities(report: &Report) -> Result<Markup, ReportError> {
    let mut figures = Vec::with_capacity(report.sensitivities.len());
    for (index, sensitivity) in report.sensitivities.iter().enumerate() {
        let figure = sensitivity.figure()?;
        let caption = sensitivity.caption();
        let id = format!("sensitivity-{index}");
        figures.push(chart(
            figure.chart(),
            &id,
            &caption,
            "Copy table",
            &sensitivity_table(sensitivity),
            shown(figure.chart()),
        ));
    }
    let two_axes = report.sensitivities.iter().any(Sensitivity::has_two_axes);
    Ok(html! {
        p.lead {
            "How much the choice matters, and whether the models see it as held-out data does. "
            @if two_axes {
                "The two vertical axes measure different things: curves should be compared by shape and ordering, \
                 not by absolute values."
            }
        }
        @for figure in figures { (figure) }
    })
}

/// The section of rollouts.
pub(super) fn rollouts(report: &Report) -> Result<Markup, ReportError> {
    let mut figures = Vec::with_capacity(report.rollouts.len());
    for (index, rollout) in report.rollouts.iter().enumerate() {
        let figure = rollout.figure()?;
        let caption = rollout.caption();
        let id = format!("rollout-{index}");
        figures.push(chart(
            figure.chart(),
            &id,
            &caption,
            "Copy all points",
            &rollout_table(rollout),
            shown(figure.chart()),
        ));
    }
    Ok(html! {
        p.lead {
            "What the models believe the plant could do, over what it did. A rollout need not follow the true \
             trajectory in time; it should move in the same range, with the same shapes and rhythm."
        }
        @for figure in figures { (figure) }
    })
}

pub(super) fn chart(
    chart: &Chart,
    id: &str,
    caption: &str,
    copy: &str,
    table: &Table,
    shown: usize,
) -> Markup {
    let scene = draw(chart, LegendPlace::Outside);
    html! {
        figure.chart id=(id) data-shown=(shown) {
            figcaption { h3 { (chart.title) } p { (caption) } }
            div.legend role="group" aria-label={ "Curves of " (chart.title) } {
                @for (index, key) in keys(chart).iter().enumerate() { (legend_entry(index, key)) }
                button.reset type="button" hidden { "Reset zoom" }
            }
            div.plot tabindex="0" role="group" aria-label={ (chart.title) ". Arrow keys read the values." } {
                (PreEscaped(svg(&scene, id, &chart.title, &chart.description)))
                div.tip hidden {}
            }
            p.hidden aria-live="polite" {}
            script type="application/json" { (PreEscaped(chart_data(chart, &scene))) }
            details {
                summary { "Data table" }
                button.copy type="button" { (copy) }
                (rows(table))
            }
        }
    }
}

/// How many curves are on at first: all, unless they are dense and many; then the truth and one rollout.
fn shown(chart: &Chart) -> usize {
    let dense = chart.series.iter().any(|series| series.marker.is_none());
    if dense && chart.series.len() > MANY_CURVES { 2 } else { chart.series.len() }
}

/// Curves can be switched off; the sign for diverged values is only explained.
fn legend_entry(index: usize, key: &Key) -> Markup {
    let sample = PreEscaped(sample_svg(key));
    html! {
        @if key.line.is_some() {
            button.key type="button" aria-pressed="true" data-series=(index) { (sample) span { (key.label) } }
        } @else {
            span.key { (sample) span { (key.label) ", at the upper edge" } }
        }
    }
}

impl Sensitivity {
    fn caption(&self) -> String {
        let Self { score, field, .. } = self;
        if self.errors.is_empty() {
            return format!(
                "Worst rank of each {field} of the grid over the members of each calibration model. \
                 There was no held-out data to compare it with."
            );
        }
        let mut caption = format!(
            "Mean {} over runs with 95 % t-intervals, for each {field} of the grid.",
            score.name
        );
        if !self.worst_ranks.is_empty() {
            caption.push_str(
                " Dashed, on the right axis: the worst rank over the members of each calibration model.",
            );
        }
        caption
    }
}

impl RolloutFigure {
    fn caption(&self) -> String {
        let longest =
            self.truth.iter().chain(&self.rollouts).map(|t| t.values.len()).max().unwrap_or(0);
        let mut caption =
            format!("In physical units, {} steps.", crate::number::count(longest as u64));
        if longest > crate::MAX_POINTS {
            // Writing to a String cannot fail.
            let _ = write!(
                caption,
                " Drawn with up to {} points for each curve, thinned so that every peak stays visible.",
                crate::number::count(crate::MAX_POINTS as u64)
            );
        }
        if usize::from(self.truth.is_some()) + self.rollouts.len() > MANY_CURVES {
            caption.push_str(" Switch further rollouts on by their names.");
        }
        caption
    }
}

fn sensitivity_table(sensitivity: &Sensitivity) -> Table {
    let mut columns = vec![sensitivity.field.clone()];
    for curve in &sensitivity.errors {
        columns.push(format!("{}: mean {}", curve.label, sensitivity.score.name));
        columns.extend(["95 % from", "to", "runs", "diverged"].map(ToOwned::to_owned));
    }
    columns
        .extend(sensitivity.worst_ranks.iter().map(|curve| format!("{}: worst rank", curve.label)));
    let row = |place: usize| {
        let mut row = vec![Cell::Setting(sensitivity.values[place].clone())];
        for curve in &sensitivity.errors {
            match &curve.summaries[place] {
                None => row.extend([const { Cell::Missing }; 5]),
                Some(summary) => {
                    let end = |end: Option<f64>| end.map_or(Cell::Missing, Cell::Number);
                    row.push(Cell::Number(summary.mean));
                    row.push(end(summary.interval.map(|interval| interval.low)));
                    row.push(end(summary.interval.map(|interval| interval.high)));
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
    };
    Table {
        title: format!("Data of {}, {}", sensitivity.sensor, sensitivity.field),
        columns,
        rows: (0..sensitivity.values.len()).map(row).collect(),
        ..Table::default()
    }
}

/// Values of all trajectories at evenly spaced times of the longest one.
fn rollout_table(rollout: &RolloutFigure) -> Table {
    let all: Vec<&Trajectory> = rollout.truth.iter().chain(&rollout.rollouts).collect();
    let end = |t: &Trajectory| t.period_secs * t.values.len().saturating_sub(1) as f64;
    let length = all.iter().map(|t| end(t)).fold(0.0, f64::max);
    let longest = all.iter().map(|t| t.values.len()).max().unwrap_or(0);
    let rows = longest.min(ROLLOUT_ROWS);
    let row = |place: usize| {
        let secs = length * place as f64 / rows.saturating_sub(1).max(1) as f64;
        let value = |t: &&Trajectory| {
            let index = (secs / t.period_secs).round() as usize;
            t.values
                .get(index)
                .filter(|value| !value.is_nan())
                .map_or(Cell::Missing, |&value| Cell::Number(value))
        };
        std::iter::once(Cell::Number(secs)).chain(all.iter().map(value)).collect()
    };
    let columns = std::iter::once("Seconds since start".to_owned())
        .chain(all.iter().map(|t| t.label.clone()));
    Table {
        title: format!("Data of {}, sampled", rollout.sensor),
        columns: columns.collect(),
        rows: (0..rows).map(row).collect(),
        ..Table::default()
    }
}
