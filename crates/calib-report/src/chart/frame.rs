//! Axes, grid and labels around a plot.

use super::scene::{Anchor, Mark, Rect, Text, Turn, fitted, text_width};
use super::tick::Tick;
use super::ticks::ticks;
use super::width::WIDE;
use super::{Axis, Colour, Dash, ScaleKind};

const TICK_SIZE: u32 = 13;
const LABEL_SIZE: u32 = 14;
/// Height of a row of names in pixels.
pub(crate) const NAME_ROW: f64 = 16.0;
/// Wanted numbers of labelled ticks on a horizontal and on a vertical axis.
const X_TICKS: usize = 9;
const Y_TICKS: usize = 6;

/// Side of the plot on which a vertical axis stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Edge {
    Left,
    Right,
}

/// Returns the width in pixels that a vertical axis needs beside the plot.
pub(crate) fn vertical_axis_width(axis: &Axis) -> f64 {
    let widest = ticks(&axis.scale, Y_TICKS)
        .iter()
        .filter_map(|tick| tick.label.as_deref())
        .map(|label| text_width(label, TICK_SIZE))
        .fold(0.0, f64::max);
    // An axis without a label needs less room.
    widest + if axis.label.is_empty() { 18.0 } else { 46.0 }
}

/// Returns the horizontal axis below `plot` with its grid lines, in a `picture` of this width.
pub(crate) fn horizontal_axis(axis: &Axis, plot: Rect, picture: f64) -> Vec<Mark> {
    let mut marks =
        vec![rule((plot.x, plot.bottom()), (plot.right(), plot.bottom()), Colour::Muted)];
    let rows = name_rows(axis, plot.width);
    let mut free_from = [f64::MIN; 2];
    let mut labelled = 0;
    for Tick { value, label } in horizontal_ticks(axis, plot, picture) {
        let x = plot.x + axis.scale.fraction(value) * plot.width;
        let length = if label.is_some() { 6.0 } else { 3.0 };
        marks.push(rule((x, plot.bottom()), (x, plot.bottom() + length), Colour::Muted));
        if let Some(label) = label {
            if !matches!(axis.scale.kind, ScaleKind::Whole | ScaleKind::Names(_)) {
                marks.extend(grid_line(
                    (x, plot.y),
                    (x, plot.bottom()),
                    x - plot.x,
                    plot.right() - x,
                ));
            }
            // Labels that would overlap are left out.
            let half = text_width(&label, TICK_SIZE) / 2.0;
            let row = labelled % rows;
            labelled += 1;
            // The last label ends at the edge of the picture.
            let x = x.min(picture - 1.0 - half);
            if x - half >= free_from[row] {
                let y = plot.bottom() + 21.0 + NAME_ROW * row as f64;
                marks.push(tick_text(x, y, label, Anchor::Middle));
                free_from[row] = x + half + 6.0;
            }
        }
    }
    if !axis.label.is_empty() {
        let room = if picture < WIDE { picture - 8.0 } else { picture };
        let text = fitted(&axis.label, LABEL_SIZE, room);
        let half = text_width(&text, LABEL_SIZE) / 2.0;
        let centre = plot.x + plot.width / 2.0;
        let end = (picture - half).max(picture / 2.0);
        let centre = if picture < WIDE { centre.min(end) } else { centre };
        marks.push(Mark::Text(Text::new(
            centre,
            plot.bottom() + 45.0,
            text,
            LABEL_SIZE,
            Anchor::Middle,
        )));
    }
    marks
}

/// Returns as many ticks as have room for their labels. Axes of names have a tick for each name.
fn horizontal_ticks(axis: &Axis, plot: Rect, picture: f64) -> Vec<Tick> {
    if matches!(axis.scale.kind, ScaleKind::Names(_)) {
        return ticks(&axis.scale, X_TICKS);
    }
    let mut all = (2..=X_TICKS).rev().map(|wanted| ticks(&axis.scale, wanted));
    all.find(|ticks| labels_fit(ticks, axis, plot, picture))
        .unwrap_or_else(|| ticks(&axis.scale, 2))
}

/// Whether the labels below a horizontal axis fit without touching.
fn labels_fit(ticks: &[Tick], axis: &Axis, plot: Rect, picture: f64) -> bool {
    let labels = ticks.iter().filter_map(|tick| Some((tick.value, tick.label.as_deref()?)));
    let mut ends: Vec<(f64, f64)> = labels
        .map(|(value, label)| {
            let half = text_width(label, TICK_SIZE) / 2.0;
            let x = plot.x + axis.scale.fraction(value) * plot.width;
            let x = x.min(picture - 1.0 - half);
            (x - half, x + half)
        })
        .collect();
    ends.sort_by(|a, b| a.0.total_cmp(&b.0));
    ends.windows(2).all(|pair| pair[0].1 + 6.0 <= pair[1].0)
}

/// Returns the number of rows for the names below a horizontal axis of `width`. Names that do not fit side by side alternate between
/// two rows, unless the axis has a label below. Axes of numbers have one row, because some labels may be left out.
pub(crate) fn name_rows(axis: &Axis, width: f64) -> usize {
    let ScaleKind::Names(names) = &axis.scale.kind else { return 1 };
    let room = width / names.len().max(1) as f64;
    let fit = names.iter().all(|name| text_width(name, TICK_SIZE) + 6.0 <= room);
    if fit || !axis.label.is_empty() { 1 } else { 2 }
}

/// Returns a vertical axis at one edge of `plot`. The left axis brings the grid lines.
pub(crate) fn vertical_axis(axis: &Axis, plot: Rect, edge: Edge) -> Vec<Mark> {
    let (x, outwards, anchor, turn) = match edge {
        Edge::Left => (plot.x, -1.0, Anchor::End, Turn::Upwards),
        Edge::Right => (plot.right(), 1.0, Anchor::Start, Turn::Downwards),
    };
    let mut marks = Vec::new();
    for Tick { value, label } in ticks(&axis.scale, Y_TICKS) {
        let y = plot.bottom() - axis.scale.fraction(value) * plot.height;
        let length = if label.is_some() { 6.0 } else { 3.0 };
        if edge == Edge::Left && label.is_some() {
            marks.extend(grid_line((plot.x, y), (plot.right(), y), y - plot.y, plot.bottom() - y));
        }
        marks.push(rule((x, y), (x + outwards * length, y), Colour::Muted));
        if let Some(label) = label {
            marks.push(tick_text(x + outwards * 10.0, y + 4.5, label, anchor));
        }
    }
    marks.push(rule((x, plot.y), (x, plot.bottom()), Colour::Muted));
    if axis.label.is_empty() {
        return marks;
    }
    let beside = x + outwards * (vertical_axis_width(axis) - 14.0);
    let centre = plot.y + plot.height / 2.0;
    // There is some free room above and below the plot.
    let text = fitted(&axis.label, LABEL_SIZE, plot.height + 40.0);
    let mut label = Text::new(beside, centre, text, LABEL_SIZE, Anchor::Middle);
    label.turn = turn;
    marks.push(Mark::Text(label));
    marks
}

/// Returns a grid line, unless it would lie on an axis.
fn grid_line(from: (f64, f64), to: (f64, f64), before: f64, after: f64) -> Option<Mark> {
    (before > 1.0 && after > 1.0).then(|| rule(from, to, Colour::Grid))
}

fn tick_text(x: f64, y: f64, label: String, anchor: Anchor) -> Mark {
    let mut text = Text::new(x, y, label, TICK_SIZE, anchor);
    text.colour = Colour::Muted;
    Mark::Text(text)
}

fn rule(from: (f64, f64), to: (f64, f64), colour: Colour) -> Mark {
    Mark::Line { points: vec![from, to], colour, width: 1.0, dash: Dash::Solid }
}
