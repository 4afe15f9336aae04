//! A sweep of several hyperparameters: their importance, one plot each, and two against each other.

use calib_core::number;
use maud::{Markup, html};

use super::figure::{legend, still_plot, still_tools};
use super::tables::rows;
use super::text::prose;
use crate::figures::{Heat, HeatCell};
use crate::{Cell, ReportError, Sensitivity, Table};

/// Steps of colour between the best and the worst cell.
const SHADES: f64 = 7.0;

/// Returns the parts on one sensor. `caption` explains the curves; `table` holds all combinations.
pub(super) fn markup(
    sensitivity: &Sensitivity,
    id: &str,
    caption: &str,
    table: &Table,
) -> Result<Markup, ReportError> {
    let figure = sensitivity.figure()?;
    let chart = figure.chart();
    let heats = sensitivity.heats();
    Ok(html! {
        figure.still.several id=(id) {
            div.figure-head {
                figcaption {
                    h3 { (chart.title) }
                    p {
                        "Each plot varies one hyperparameter and keeps the others at the choice. All have the same vertical axes. " (prose(caption))
                    }
                }
                (still_tools(&chart.title))
            }
            (legend(chart))
            (still_plot(&figure, id))
            h4 { "What matters" }
            p.caption {
                "Share of the differences between all settings that one hyperparameter alone explains, by the logarithm of the error. The rest to 100 % depends on two or more together."
            }
            (rows(&importance_table(sensitivity)))
            @if let Some(first) = heats.first() {
                h4 { (first.row_field) " against " (first.column_field) }
                p.caption {
                    "The best over all other hyperparameters. The stronger the colour, the better; the choice is framed."
                }
                div.heats { @for heat in &heats { (heat_table(heat)) } }
            }
            details.data {
                summary { "All combinations" }
                button.copy type="button" { "Copy table" }
                (rows(table))
            }
        }
    })
}

fn importance_table(sensitivity: &Sensitivity) -> Table {
    let importances = sensitivity.importances();
    Table {
        title: format!("What matters for {}", sensitivity.sensor),
        columns: std::iter::once("Hyperparameter".to_owned()).chain(importances.labels).collect(),
        rows: importances
            .shares
            .into_iter()
            .map(|(field, shares)| {
                std::iter::once(Cell::Text(field))
                    .chain(
                        shares.into_iter().map(|share| share.map_or(Cell::Missing, Cell::Percent)),
                    )
                    .collect()
            })
            .collect(),
        ..Table::default()
    }
}

fn heat_table(heat: &Heat) -> Markup {
    html! {
        div.heat {
            h4 { (heat.label) }
            div.scroll tabindex="0" role="region" aria-label=(heat.label) {
                table {
                    caption.hidden { (heat.label) ", " (heat.row_field) " down, " (heat.column_field) " across" }
                    thead { tr {
                        th scope="col" { (heat.row_field) " ↓ " (heat.column_field) " →" }
                        @for column in &heat.columns { th.number scope="col" { (column) } }
                    } }
                    tbody {
                        @for (row, cells) in heat.rows.iter().zip(&heat.cells) {
                            tr { th scope="row" { (row) } @for cell in cells { (heat_cell(cell.as_ref())) } }
                        }
                    }
                }
            }
        }
    }
}

fn heat_cell(cell: Option<&HeatCell>) -> Markup {
    let Some(cell) = cell else { return html! { td.none { "–" } } };
    let mut class = cell.place.map_or_else(
        || "diverged".to_owned(),
        |place| format!("h{}", (place * SHADES).min(SHADES - 1.0).floor()),
    );
    if cell.is_chosen {
        class.push_str(" chosen");
    }
    html! {
        td class=(class) {
            (number(cell.value)) @if cell.is_chosen { span.hidden { " (choice)" } }
        }
    }
}
