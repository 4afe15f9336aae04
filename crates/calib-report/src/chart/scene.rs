//! Marks at pixel positions: the result of a chart's layout.

use super::{Colour, Dash, Marker};

/// A picture of `width` × `height` pixels, painted group by group.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Scene {
    pub(crate) width: f64,
    pub(crate) height: f64,
    /// The rectangle between the axes. With several plots, that of the last plot.
    pub(crate) plot: Rect,
    pub(crate) groups: Vec<MarkGroup>,
}

/// Marks that belong together.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct MarkGroup {
    pub(crate) kind: GroupKind,
    /// The plot of the group; curves are clipped to it.
    pub(crate) plot: Rect,
    pub(crate) marks: Vec<Mark>,
}

/// Kind of a group. The page's script finds groups by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum GroupKind {
    /// Grid, axes and labels of one axis: "x", "left", "right".
    Axis(&'static str),
    /// Title and legend.
    Heading,
    /// Vertical lines with the text above them.
    Rules,
    /// Curve number i, clipped to the plot.
    Series(usize),
}

#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Rect {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) width: f64,
    pub(crate) height: f64,
}

impl Rect {
    pub(crate) fn right(&self) -> f64 {
        self.x + self.width
    }

    pub(crate) fn bottom(&self) -> f64 {
        self.y + self.height
    }
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Mark {
    Line {
        points: Vec<(f64, f64)>,
        colour: Colour,
        width: f64,
        dash: Dash,
    },
    /// A closed, filled polygon, mostly transparent.
    Area {
        points: Vec<(f64, f64)>,
        colour: Colour,
    },
    Symbol {
        x: f64,
        y: f64,
        marker: Marker,
        colour: Colour,
    },
    Text(Text),
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Text {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) content: String,
    pub(crate) size: u32,
    pub(crate) anchor: Anchor,
    pub(crate) colour: Colour,
    pub(crate) weight: Weight,
    pub(crate) turn: Turn,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Anchor {
    Start,
    Middle,
    End,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Weight {
    Regular,
    Bold,
}

/// Direction of writing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Turn {
    Level,
    /// Bottom to top, for the left axis.
    Upwards,
    /// Top to bottom, for the right axis.
    Downwards,
}

impl Turn {
    pub(crate) const fn degrees(self) -> Option<f64> {
        match self {
            Self::Level => None,
            Self::Upwards => Some(-90.0),
            Self::Downwards => Some(90.0),
        }
    }
}

impl Text {
    pub(crate) fn new(
        x: f64,
        y: f64,
        content: impl Into<String>,
        size: u32,
        anchor: Anchor,
    ) -> Self {
        let colour = Colour::Ink;
        let weight = Weight::Regular;
        let turn = Turn::Level;
        Self { x, y, content: content.into(), size, anchor, colour, weight, turn }
    }
}

/// Returns the outline of `marker` around the origin, as a closed polygon; circles have none.
pub(crate) fn outline(marker: Marker) -> Vec<(f64, f64)> {
    match marker {
        Marker::Circle => Vec::new(),
        Marker::Square => vec![(-3.6, -3.6), (3.6, -3.6), (3.6, 3.6), (-3.6, 3.6)],
        Marker::Triangle => vec![(0.0, -4.8), (4.6, 3.4), (-4.6, 3.4)],
        Marker::TriangleDown => vec![(0.0, 4.8), (-4.6, -3.4), (4.6, -3.4)],
        Marker::Diamond => vec![(0.0, -5.2), (5.2, 0.0), (0.0, 5.2), (-5.2, 0.0)],
        Marker::Cross => {
            let arm = [(1.2, 0.0), (4.6, 3.4), (3.4, 4.6), (0.0, 1.2)];
            (0..4).flat_map(|turn| arm[..3].iter().map(move |&p| quarter_turns(p, turn))).collect()
        }
    }
}

/// Radius of a circle marker in pixels.
pub(crate) const CIRCLE_RADIUS: f64 = 4.0;

fn quarter_turns((x, y): (f64, f64), turns: usize) -> (f64, f64) {
    match turns {
        0 => (x, y),
        1 => (-y, x),
        2 => (-x, -y),
        _ => (y, -x),
    }
}

/// Estimates the width of `text` at `size` pixels. The estimate is generous,
/// so that nothing overlaps in any common font.
pub(crate) fn text_width(text: &str, size: u32) -> f64 {
    let units: f64 =
        text.chars()
            .map(|c| match c {
                'i' | 'l' | 'j' | 't' | 'f' | ' ' | '.' | ',' | ':' | '(' | ')' | '-' | '\''
                | '|' => 0.37,
                'm' | 'w' | 'M' | 'W' | '%' => 0.95,
                c if c.is_ascii_uppercase() => 0.71,
                c if (c as u32) < 0x2e80 => 0.62,
                _ => 1.0,
            })
            .sum();
    units * f64::from(size)
}

/// Breaks `text` into lines that fit in `room` at `size` pixels. A longer word stands alone.
pub(crate) fn lines(text: &str, size: u32, room: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if text_width(&format!("{line} {word}"), size) <= room => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Shortens `text` with an ellipsis until it fits in `room` at `size` pixels.
pub(crate) fn fitted(text: &str, size: u32, room: f64) -> String {
    if text_width(text, size) <= room {
        return text.to_owned();
    }
    let mut short = text.to_owned();
    while short.pop().is_some() {
        let cut = format!("{}…", short.trim_end());
        if text_width(&cut, size) <= room {
            return cut;
        }
    }
    text.to_owned()
}
