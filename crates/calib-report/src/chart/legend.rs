//! The legend: rows above the plot, where they cannot cover a curve.

use super::scene::{Anchor, Mark, Text, text_width};
use super::{Chart, Colour, Dash, Marker, Side};

const SIZE: u32 = 13;
const ROW_HEIGHT: f64 = 22.0;
/// Width of the line sample beside each name, in pixels.
pub(crate) const SAMPLE: f64 = 30.0;

/// One entry of the legend: the look of a curve and its name.
pub(crate) struct Key {
    pub(crate) label: String,
    pub(crate) colour: Colour,
    pub(crate) line: Option<(f64, Dash)>,
    pub(crate) marker: Option<Marker>,
}

/// A key with its position: the left end of its line sample, and the middle of its row.
pub(crate) struct Entry {
    key: Key,
    x: f64,
    y: f64,
}

/// Returns the keys of `chart`: one per curve, in order, and one
/// for diverged values if there are any.
pub(crate) fn keys(chart: &Chart) -> Vec<Key> {
    let mut keys: Vec<Key> = chart
        .series
        .iter()
        .map(|series| Key {
            label: match (&chart.right, series.side) {
                (Some(_), Side::Right) => format!("{} (right axis)", series.label),
                _ => series.label.clone(),
            },
            colour: series.colour,
            line: Some((series.width.max(1.6), series.dash)),
            marker: series.marker,
        })
        .collect();
    if chart.diverges() {
        let marker = Some(Marker::Cross);
        keys.push(Key { label: "diverged".to_owned(), colour: Colour::Ink, line: None, marker });
    }
    keys
}

/// Places `keys` in rows from (`left`, `top`), at most `width` wide.
pub(crate) fn place(keys: Vec<Key>, left: f64, top: f64, width: f64) -> Vec<Entry> {
    let mut x = left;
    let mut y = top + ROW_HEIGHT / 2.0;
    let mut entries = Vec::with_capacity(keys.len());
    for key in keys {
        let entry_width = SAMPLE + 8.0 + text_width(&key.label, SIZE) + 22.0;
        if x > left && x + entry_width > left + width {
            (x, y) = (left, y + ROW_HEIGHT);
        }
        entries.push(Entry { key, x, y });
        x += entry_width;
    }
    entries
}

/// Returns the height of all rows.
pub(crate) fn height(entries: &[Entry], top: f64) -> f64 {
    entries.last().map_or(0.0, |entry| entry.y + ROW_HEIGHT / 2.0 - top)
}

/// Returns the marks of the legend.
pub(crate) fn marks(entries: &[Entry]) -> Vec<Mark> {
    let mut marks = Vec::with_capacity(3 * entries.len());
    for Entry { key, x, y } in entries {
        marks.extend(sample(key, *x, *y));
        marks.push(Mark::Text(Text::new(
            x + SAMPLE + 8.0,
            y + 4.5,
            &*key.label,
            SIZE,
            Anchor::Start,
        )));
    }
    marks
}

/// Returns a piece of the curve, `SAMPLE` wide, from (`x`, `y`).
pub(crate) fn sample(key: &Key, x: f64, y: f64) -> Vec<Mark> {
    let colour = key.colour;
    let line = key.line.map(|(width, dash)| {
        let points = vec![(x, y), (x + SAMPLE, y)];
        Mark::Line { points, colour, width, dash }
    });
    let symbol = key.marker.map(|marker| Mark::Symbol { x: x + SAMPLE / 2.0, y, marker, colour });
    line.into_iter().chain(symbol).collect()
}
