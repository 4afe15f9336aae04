//! A chart as data, laid out once and painted as SVG, as PNG, or into the page.
//!  [`Chart`] says what is shown. [`layout`] turns it into marks at pixel positions ([`scene`]). [`svg`] and
//! [`png`] paint the marks. [`data`] gives the page's script the same numbers for hovering. The layout is our own,
//! because one layout must serve all three, with twin axes and a legend that never covers the curves. tiny-skia
//! only turns marks into pixels.

mod data;
mod dates;
mod frame;
mod glyphs;
mod grid;
mod layout;
mod legend;
mod packed;
mod png;
mod scale;
mod scene;
mod svg;
mod tick;
mod ticks;
mod width;

use crate::downsample::min_max_indices;

pub(crate) use data::chart_data;
pub(crate) use grid::{GridCell, draw_grid, draw_stacked};
pub(crate) use layout::{LegendPlace, draw, draw_panels};
pub(crate) use legend::{Key, keys};
pub(crate) use packed::Detail;
pub(crate) use png::png;
pub(crate) use scale::extent;
pub use scale::{Scale, ScaleKind};
pub(crate) use scene::Scene;
pub(crate) use svg::{sample_svg, svg};
pub(crate) use width::{NARROW, WIDE};

/// A chart: curves over a common horizontal axis, on one or two vertical axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    /// Title above the figure.
    pub title: String,
    /// Description in one sentence for readers who cannot see the chart.
    pub description: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Left vertical axis.
    pub left: Axis,
    /// Right vertical axis, if any curve uses one.
    pub right: Option<Axis>,
    /// The curves, drawn in this order.
    pub series: Vec<Series>,
    /// Vertical lines that mark values of the horizontal axis.
    pub rules: Vec<Rule>,
}

/// Points of a dense curve in a narrow picture, about two per pixel. Many curves share the points of a few.
const NARROW_POINTS: usize = 450;
const NARROW_CURVES: usize = 4;
const FEWEST_NARROW_POINTS: usize = 120;

impl Chart {
    /// Creates a chart with curves only: no title, right axis or marks.
    pub(crate) const fn of(x: Axis, left: Axis, series: Vec<Series>) -> Self {
        let title = String::new();
        let description = String::new();
        Self { title, description, x, left, right: None, series, rules: Vec::new() }
    }

    /// Whether a curve diverges somewhere.
    pub(crate) fn diverges(&self) -> bool {
        self.series.iter().flat_map(|series| &series.points).any(|point| point.y.is_infinite())
    }

    /// Returns the chart with fewer points in its dense curves, for a narrow picture. Peaks stay.
    pub(crate) fn thinned(&self) -> Self {
        let shared = NARROW_CURVES * NARROW_POINTS / self.series.len().max(1);
        let most = shared.clamp(FEWEST_NARROW_POINTS, NARROW_POINTS);
        Self {
            series: self
                .series
                .iter()
                .map(|series| {
                    if series.marker.is_some()
                        || series
                            .points
                            .iter()
                            .any(|point| point.interval.is_some() || !point.y.is_finite())
                    {
                        return series.clone();
                    }
                    let values: Vec<f64> = series.points.iter().map(|point| point.y).collect();
                    let kept = min_max_indices(&values, most).into_iter();
                    let points = kept.map(|place| series.points[place]).collect();
                    Series { points, ..series.clone() }
                })
                .collect(),
            ..self.clone()
        }
    }
}

/// One axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// Quantity and unit.
    pub label: String,
    /// Range and spacing.
    pub scale: Scale,
}

/// A labelled vertical line.
#[derive(Debug, Clone, PartialEq)]
pub struct Rule {
    /// Position on the horizontal axis.
    pub x: f64,
    /// Text above the line.
    pub label: String,
    /// Pattern of the line.
    pub dash: Dash,
}

/// One curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name in the legend.
    pub label: String,
    /// Vertical axis of the curve.
    pub side: Side,
    /// Colour by role, so that light and dark pages can differ.
    pub colour: Colour,
    /// Line pattern.
    pub dash: Dash,
    /// Line width in pixels.
    pub width: f64,
    /// Shape at each point; `None` for dense curves.
    pub marker: Option<Marker>,
    /// Points from left to right. NaN breaks the line, and an infinite value is marked as diverged.
    pub points: Vec<Point>,
}

const MARKERS: [Marker; 5] =
    [Marker::Circle, Marker::Square, Marker::Triangle, Marker::Diamond, Marker::TriangleDown];
const DASHES: [Dash; 3] = [Dash::Solid, Dash::Dashed, Dash::Dotted];

impl Series {
    /// Returns a linear scale that holds the finite points of all `series` and the ends of their intervals, with a margin.
    pub fn scale_around(series: &[Self]) -> Scale {
        let ends = series.iter().flat_map(|series| &series.points).flat_map(|point| {
            let (low, high) = point.interval.unwrap_or((point.y, point.y));
            [point.y, low, high]
        });
        Scale::linear_around(&ends.collect::<Vec<_>>())
    }

    /// Returns a curve on the left axis that looks unlike the curves with other numbers.
    pub fn numbered(number: usize, label: &str, points: Vec<Point>) -> Self {
        Self {
            label: label.to_owned(),
            side: Side::Left,
            colour: Colour::Curve(number),
            dash: DASHES[number / 6 % DASHES.len()],
            width: 1.6,
            marker: Some(MARKERS[number % MARKERS.len()]),
            points,
        }
    }
}

/// One point of a curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Horizontal position.
    pub x: f64,
    /// Value.
    pub y: f64,
    /// Ends of the interval, if the point has one.
    pub interval: Option<(f64, f64)>,
}

/// Vertical axis of a curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The left one.
    Left,
    /// The right one.
    Right,
}

/// Line patterns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dash {
    /// Unbroken.
    Solid,
    /// Long dashes.
    Dashed,
    /// Dots.
    Dotted,
}

/// Shapes of points. Every curve has its own shape, so that colour is never the only difference.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Marker {
    /// ●
    Circle,
    /// ■
    Square,
    /// ▲
    Triangle,
    /// ▼
    TriangleDown,
    /// ◆
    Diamond,
    /// ✕, for diverged values.
    Cross,
}

/// Colours by role. The hues are those of Okabe & Ito (2008); people with the
/// common kinds of colour blindness can distinguish them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Colour {
    /// Text.
    Ink,
    /// True trajectories, drawn beneath the rollouts.
    Truth,
    /// Axis text and baselines.
    Muted,
    /// Grid lines.
    Grid,
    /// Curve colour 0 to 5; larger numbers start again.
    Curve(usize),
    /// One of eight colours for ordered values, from the smallest to the largest.
    Ordered(usize),
}

/// Number of colours for ordered values: more could not be distinguished.
pub(crate) const ORDERED: usize = 8;

impl Colour {
    /// Returns the colour of the value at `place` of `count` ordered values. The smallest and the largest have the
    /// ends of the scale.
    pub(crate) const fn of_ordered(place: usize, count: usize) -> Self {
        let last = if count > 1 { count - 1 } else { 1 };
        Self::Ordered((2 * place * (ORDERED - 1) + last) / (2 * last))
    }

    /// Returns the colour on light pages, `#rrggbb`. The page's style sheet overrides it by [`class`](Self::class).
    pub(crate) const fn hex(self) -> &'static str {
        match self {
            Self::Ink => "#1b2733",
            Self::Truth => "#8b97a4",
            Self::Muted => "#5b6875",
            Self::Grid => "#e3e8ed",
            Self::Curve(index) => {
                ["#0072b2", "#d55e00", "#009e73", "#a8479a", "#8a6d1d", "#3d8fc4"][index % 6]
            }
            Self::Ordered(step) => [
                "#1d0f70", "#4b0c93", "#7a0f9b", "#a2228e", "#c23c75", "#d05050", "#c9661f",
                "#a87a00",
            ][step % ORDERED],
        }
    }

    /// Returns the same colour as red, green and blue.
    pub(crate) fn rgb(self) -> [u8; 3] {
        let rgb = u32::from_str_radix(&self.hex()[1..], 16).unwrap_or(0);
        let [_, red, green, blue] = rgb.to_be_bytes();
        [red, green, blue]
    }

    /// Returns the name of the colour in the page's style sheet.
    pub(crate) const fn class(self) -> &'static str {
        match self {
            Self::Ink => "ink",
            Self::Truth => "truth",
            Self::Muted => "muted",
            Self::Grid => "grid",
            Self::Curve(index) => ["c0", "c1", "c2", "c3", "c4", "c5"][index % 6],
            Self::Ordered(step) => ["s0", "s1", "s2", "s3", "s4", "s5", "s6", "s7"][step % ORDERED],
        }
    }
}

impl Dash {
    /// Returns the lengths of ink and gap in pixels; `None` for an unbroken line.
    pub(crate) const fn lengths(self) -> Option<(f64, f64)> {
        match self {
            Self::Solid => None,
            Self::Dashed => Some((7.0, 4.0)),
            Self::Dotted => Some((2.0, 3.0)),
        }
    }
}
