//! Many small plots in rows and columns, as papers print them.

use super::Chart;
use super::frame::vertical_axis_width;
use super::layout::{LegendPlace, MARGIN, Sides, WIDTH, heading, panel, rule_height};
use super::scene::{Anchor, Group, GroupKind, Mark, Rect, Scene, Text, Weight};

const HEADING: f64 = 22.0;
const HEADING_SIZE: u32 = 14;
/// Between a column and the axis of the next one.
const GAP: f64 = 12.0;

/// A plot of a grid, with a heading where its column begins.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct GridCell {
    pub(crate) heading: Option<String>,
    /// What is drawn; `None` keeps the place free.
    pub(crate) chart: Option<Chart>,
}

/// Lays `rows` of cells out below the title of `legend_of` and the keys of its curves. All plots are equally wide
/// and `height` pixels high.
pub(crate) fn draw_grid(
    legend_of: &Chart,
    rows: &[Vec<GridCell>],
    height: f64,
    legend_place: LegendPlace,
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
    let width = (WIDTH - 2.0 * MARGIN - GAP * (columns - 1) as f64 - taken) / columns as f64;
    let mut from = MARGIN;
    let sides: Vec<Sides> = beside
        .iter()
        .map(|(left, right)| {
            let sides = Sides { left: from + left, width };
            from = sides.left + width + right + GAP;
            sides
        })
        .collect();
    let mut scene = Scene { width: WIDTH, height: 0.0, plot: Rect::default(), groups: Vec::new() };
    let above = Sides { left: MARGIN + 4.0, width: WIDTH - 2.0 * MARGIN };
    if legend_place == LegendPlace::Inside {
        scene.height = heading(&mut scene.groups, legend_of, &legend_of.title, above);
    }
    for row in rows {
        let has_headings = row.iter().any(|cell| cell.heading.is_some());
        let top = scene.height + if has_headings { HEADING } else { 0.0 };
        // Plots of a row begin at the same height, however many lines of text are above each.
        let rules = |(cell, &sides): (&GridCell, &Sides)| {
            cell.chart.as_ref().map_or(0.0, |chart| rule_height(chart, sides))
        };
        let room = row.iter().zip(&sides).map(rules).fold(0.0, f64::max);
        let mut bottom = top;
        for (cell, &sides) in row.iter().zip(&sides) {
            if let Some(text) = &cell.heading {
                scene.groups.push(column_heading(text, top - 4.0, sides));
            }
            if let Some(chart) = &cell.chart {
                scene.height = top + room - rule_height(chart, sides);
                panel(&mut scene, chart, sides, height);
                bottom = bottom.max(scene.height);
            }
        }
        scene.height = bottom;
    }
    scene
}

fn column_heading(text: &str, y: f64, sides: Sides) -> Group {
    let mut text = Text::new(sides.left, y, text, HEADING_SIZE, Anchor::Start);
    text.weight = Weight::Bold;
    let marks = vec![Mark::Text(text)];
    Group { kind: GroupKind::Heading, plot: Rect::default(), marks }
}
