//! Many small plots in rows and columns, as papers print them.

use super::Chart;
use super::frame::vertical_axis_width;
use super::layout::{MARGIN, Sides, WIDTH, heading, panel};
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

/// Lays `rows` of cells out below the title of `legend_of` and the keys of its curves. The plots of a column are
/// equally wide and lie below each other, each `height` pixels high.
pub(crate) fn draw_grid(legend_of: &Chart, rows: &[Vec<GridCell>], height: f64) -> Scene {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0).max(1);
    let cell_width = (WIDTH - 2.0 * MARGIN - GAP * (columns - 1) as f64) / columns as f64;
    let sides: Vec<Sides> = (0..columns)
        .map(|column| {
            let charts = rows.iter().filter_map(|row| row.get(column)?.chart.as_ref());
            let (mut left, mut right) = (0.0_f64, 4.0_f64);
            for chart in charts {
                left = left.max(vertical_axis_width(&chart.left));
                right = right.max(chart.right.as_ref().map_or(0.0, vertical_axis_width));
            }
            let start = MARGIN + column as f64 * (cell_width + GAP);
            Sides { left: start + left, width: cell_width - left - right }
        })
        .collect();
    let mut scene = Scene { width: WIDTH, height: 0.0, plot: Rect::default(), groups: Vec::new() };
    let above = Sides { left: MARGIN + 4.0, width: WIDTH - 2.0 * MARGIN };
    scene.height = heading(&mut scene.groups, legend_of, &legend_of.title, above);
    for row in rows {
        let has_headings = row.iter().any(|cell| cell.heading.is_some());
        let top = scene.height + if has_headings { HEADING } else { 0.0 };
        let mut bottom = top;
        for (cell, &sides) in row.iter().zip(&sides) {
            if let Some(text) = &cell.heading {
                scene.groups.push(column_heading(text, top - 4.0, sides));
            }
            if let Some(chart) = &cell.chart {
                scene.height = top;
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
