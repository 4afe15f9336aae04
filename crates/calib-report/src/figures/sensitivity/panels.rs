//! The sensitivity curves of all sensors in one figure.

use super::Sensitivity;
use crate::chart::{Chart, GridCell};
use crate::{Figure, ReportError};

const COLUMNS: usize = 3;
const HEIGHT: f64 = 210.0;

impl Sensitivity {
    /// Draws several sensitivity figures side by side, up to three per row, under one legend, as in the paper.
    ///
    /// # Errors
    ///
    /// If one of them cannot be drawn, or there is none.
    pub fn panels(all: &[Self]) -> Result<Figure, ReportError> {
        if let Some(figure) = Self::sliced_panels(all)? {
            return Ok(figure);
        }
        let mut charts = Vec::with_capacity(all.len());
        for one in all {
            charts.push(one.figure()?.chart().clone());
        }
        let title = "Sensitivity".to_owned();
        let Some(first) = charts.first() else {
            return Err(ReportError::Empty { figure: title, missing: "panels" });
        };
        let mut head = first.clone();
        let field = &all[0].field;
        let same_field = all.iter().all(|one| one.field == *field);
        head.title = if same_field { format!("{title} to {field}") } else { title };
        head.description = descriptions(&charts);
        // The legend explains the sign for diverged values if any plot has one.
        head.series = widest(&charts);
        let columns = if all.len() == 4 { 2 } else { all.len().min(COLUMNS) };
        let last = charts.len() - 1;
        let cells: Vec<GridCell> = charts
            .into_iter()
            .zip(all)
            .enumerate()
            .map(|(place, (chart, one))| {
                let mut chart = chart;
                let column = place % columns;
                if column != 0 {
                    chart.left.label = spacing_only(&chart.left.label);
                }
                if let Some(right) =
                    chart.right.as_mut().filter(|_| column + 1 != columns && place != last)
                {
                    right.label.clear();
                }
                GridCell { heading: Some(one.sensor.clone()), chart: Some(chart) }
            })
            .collect();
        Ok(Figure::with_grid(head, cells.chunks(columns).map(<[_]>::to_vec).collect(), HEIGHT))
    }

    /// Returns one or more rows per sensor, if several hyperparameters are swept.
    fn sliced_panels(all: &[Self]) -> Result<Option<Figure>, ReportError> {
        let slices: Vec<Vec<Self>> = all.iter().map(Self::slices).collect();
        if slices.is_empty() || slices.iter().any(Vec::is_empty) {
            return Ok(None);
        }
        let mut head = all[0].figure()?.chart().clone();
        "Sensitivity, through the choice of each sensor".clone_into(&mut head.title);
        let rows: Vec<Vec<GridCell>> = all
            .iter()
            .zip(&slices)
            .flat_map(|(one, slices)| one.slice_rows(slices, Some(&one.sensor)))
            .collect();
        let charts: Vec<Chart> =
            rows.iter().flatten().filter_map(|cell| cell.chart.clone()).collect();
        head.description = descriptions(&charts);
        head.series = widest(&charts);
        Ok(Some(Figure::with_grid(head, rows, HEIGHT)))
    }
}

fn descriptions(charts: &[Chart]) -> String {
    charts.iter().map(|chart| chart.description.as_str()).collect::<Vec<_>>().join(" ")
}

/// Returns the curves of the chart with most curves, and a diverged point if any chart has one.
fn widest(charts: &[Chart]) -> Vec<crate::Series> {
    let most = charts.iter().map(|chart| chart.series.len()).max().unwrap_or(0);
    let mut fullest = charts.iter().filter(|chart| chart.series.len() == most);
    let chosen = fullest.clone().find(|chart| chart.diverges()).or_else(|| fullest.next());
    chosen.map(|chart| chart.series.clone()).unwrap_or_default()
}

/// Keeps the part of a label that says whether the axis is logarithmic. Plots further right need no more.
fn spacing_only(label: &str) -> String {
    if label.contains("log scale") { "log scale".to_owned() } else { String::new() }
}
