//! Many small plots in rows and columns, as in papers.

use super::Chart;
use super::frame::vertical_axis_width;
use super::layout::{LegendPlace, MARGIN, Sides, heading, panel, rule_height};
use super::scene::{Anchor, GroupKind, Mark, MarkGroup, Rect, Scene, Text, Weight, lines};
use super::width::{NARROW, WIDE};

const HEADING: f64 = 22.0;
const HEADING_SIZE: u32 = 14;
const HEADING_ROW: f64 = 18.0;
/// Width of bold text relative to regular text.
const BOLD: f64 = 1.13;
/// Distance between a column and the axis of the next column, in pixels.
const GAP: f64 = 12.0;

/// A plot of a grid, with a heading at the top of its column.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct GridCell {
    pub(crate) heading: Option<String>,
    /// The chart; `None` leaves the place empty.
    pub(crate) chart: Option<Chart>,
}

/// Lays out `rows` of cells below the title and the legend of `legend_of`. All
/// plots have equal widths, and are `height` pixels high.
pub(crate) fn draw_grid(
    legend_of: &Chart,
    rows: &[Vec<GridCell>],
    height: f64,
    legend_place: LegendPlace,
) -> Scene {
    draw_rows(legend_of, rows, height, legend_place, WIDE)
}

/// Lays out the same plots below each other, for a narrow screen. Title and legend are left out, because the page has them.
pub(crate) fn draw_stacked(legend_of: &Chart, rows: &[Vec<GridCell>], height: f64) -> Scene {
    draw_rows(legend_of, &stacked(rows), height, LegendPlace::Outside, NARROW)
}

/// Puts each plot into a row of its own. Each plot then repeats the heading of its column and the labels of its vertical axes,
/// which a grid shows once.
fn stacked(rows: &[Vec<GridCell>]) -> Vec<Vec<GridCell>> {
    let first = rows.first().map_or(&[][..], Vec::as_slice);
    let has_columns = first.len() > 1 && first.iter().all(|cell| cell.heading.is_some());
    let mut all = Vec::new();
    for row in rows {
        let charts: Vec<&Chart> = row.iter().filter_map(|cell| cell.chart.as_ref()).collect();
        let left = charts.iter().map(|chart| &chart.left.label).find(|label| !label.is_empty());
        let right = charts.iter().filter_map(|chart| chart.right.as_ref());
        let right = right.map(|axis| &axis.label).find(|label| !label.is_empty());
        for (column, cell) in row.iter().enumerate() {
            let Some(mut chart) = cell.chart.clone() else { continue };
            let heading = if has_columns {
                // In such a grid the left label is the name of the row.
                chart.left.label.clear();
                let names = [left, first.get(column).and_then(|cell| cell.heading.as_ref())];
                Some(names.into_iter().flatten().cloned().collect::<Vec<_>>().join(": "))
            } else {
                chart.left.label = left.cloned().unwrap_or_default();
                cell.heading.clone()
            };
            if let (Some(axis), Some(label)) = (&mut chart.right, right) {
                axis.label.clone_from(label);
            }
            all.push(vec![GridCell { heading, chart: Some(chart) }]);
        }
    }
    all
}

fn draw_rows(
    legend_of: &Chart,
    rows: &[Vec<GridCell>],
    height: f64,
    legend_place: LegendPlace,
    picture: f64,
) -> Scene {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0).max(1);
    let beside: Vec<(f64, f64)> = (0..columns)
        .map(|column| {
            let charts = rows.iter().filter_map(|row| row.get(column)?.chart.as_ref());
            charts.fold((0.0, 4.0), |(left, right), chart| {
                let own = chart.right.as_ref().map_or(0.0, vertical_axis_width);
                (vertical_axis_width(&chart.left).max(left), own.max(right))
            })
        })
        .collect();
    let taken: f64 = beside.iter().map(|(left, right)| left + right).sum();
    let width = (picture - 2.0 * MARGIN - GAP * (columns - 1) as f64 - taken) / columns as f64;
    let mut from = MARGIN;
    let sides: Vec<Sides> = beside
        .iter()
        .map(|(left, right)| {
            let sides = Sides { left: from + left, width };
            from = sides.left + width + right + GAP;
            sides
        })
        .collect();
    let mut scene =
        Scene { width: picture, height: 0.0, plot: Rect::default(), groups: Vec::new() };
    let above = Sides { left: MARGIN + 4.0, width: picture - 2.0 * MARGIN };
    if legend_place == LegendPlace::Inside {
        heading(&mut scene, legend_of, above);
    }
    for row in rows {
        let headings: Vec<Vec<String>> = row
            .iter()
            .enumerate()
            .map(|(column, cell)| {
                let end = sides.get(column + 1).map_or(picture - MARGIN, |next| next.left);
                let heading = cell.heading.as_deref();
                heading.map_or_else(Vec::new, |text| {
                    lines(text, HEADING_SIZE, (end - heading_left(sides[column], picture)) / BOLD)
                })
            })
            .collect();
        let most = headings.iter().map(Vec::len).max().unwrap_or(0);
        let above = if most == 0 { 0.0 } else { HEADING + HEADING_ROW * (most - 1) as f64 };
        let top = scene.height + above;
        // The plots of a row begin at the same height, however many lines of text stand above each plot.
        let rules = row.iter().zip(&sides).map(|(cell, &sides)| {
            cell.chart.as_ref().map_or(0.0, |chart| rule_height(chart, sides, picture))
        });
        let room = rules.fold(0.0, f64::max);
        let mut bottom = top;
        for ((cell, &sides), heading) in row.iter().zip(&sides).zip(headings) {
            if !heading.is_empty() {
                scene.groups.push(column_heading(heading, top - 4.0, heading_left(sides, picture)));
            }
            if let Some(chart) = &cell.chart {
                scene.height = top + room - rule_height(chart, sides, picture);
                panel(&mut scene, chart, sides, height);
                bottom = bottom.max(scene.height);
            }
        }
        scene.height = bottom;
    }
    scene
}

/// Returns the left end of a heading: that of its plot, or the edge of a narrow picture, where there is more room.
fn heading_left(sides: Sides, picture: f64) -> f64 {
    if picture < WIDE { 4.0 } else { sides.left }
}

/// Returns lines of text, the last one at `y`.
fn column_heading(lines: Vec<String>, y: f64, left: f64) -> MarkGroup {
    let last = lines.len().saturating_sub(1);
    let marks = lines
        .into_iter()
        .enumerate()
        .map(|(place, line)| {
            let up = HEADING_ROW * (last - place) as f64;
            let mut text = Text::new(left, y - up, line, HEADING_SIZE, Anchor::Start);
            text.weight = Weight::Bold;
            Mark::Text(text)
        })
        .collect();
    MarkGroup { kind: GroupKind::Heading, plot: Rect::default(), marks }
}
