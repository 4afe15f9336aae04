//! Layout of a chart: marks at pixel positions.

use super::frame::{
    Edge, NAME_ROW, horizontal_axis, name_rows, vertical_axis, vertical_axis_width,
};
use super::legend;
use super::scene::{Anchor, GroupKind, Mark, MarkGroup, Rect, Scene, Text, Weight, text_width};
use super::width::WIDE;
use super::{Chart, Colour, Dash, Marker, Point, Scale, Series, Side};
const PLOT_HEIGHT: f64 = 360.0;
const NARROW_PLOT_HEIGHT: f64 = 260.0;
pub(super) const MARGIN: f64 = 14.0;
const PANEL_HEIGHT: f64 = 210.0;
/// Room in pixels for tick labels, and for tick labels with the label of the horizontal axis.
const BELOW_UNLABELLED: f64 = 34.0;
const BELOW: f64 = 58.0;
const RULE_SIZE: u32 = 12;
const RULE_ROW: f64 = 17.0;
/// Curves with more intervals than this have a band and no whiskers.
const BAND_ABOVE_POINTS: usize = 40;

/// Place of the title and the legend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LegendPlace {
    /// Inside the picture, which stands alone.
    Inside,
    /// Outside: the page around the picture has them.
    Outside,
}

/// Lays out `chart` in a picture that is `width` pixels wide.
pub(crate) fn draw(chart: &Chart, legend_place: LegendPlace, width: f64) -> Scene {
    let side = Sides::of(std::slice::from_ref(chart), width);
    let mut scene = Scene { width, height: MARGIN, plot: Rect::default(), groups: Vec::new() };
    if legend_place == LegendPlace::Inside {
        heading(&mut scene, chart, side);
    }
    let height = if width < WIDE { NARROW_PLOT_HEIGHT } else { PLOT_HEIGHT };
    panel(&mut scene, chart, side, height);
    scene
}

/// Lays out `panels` below each other, with one heading (title, and legend of `legend_of`) and one horizontal scale.
pub(crate) fn draw_panels(legend_of: &Chart, panels: &[Chart]) -> Scene {
    let sides = Sides::of(panels, WIDE);
    let mut scene = Scene { width: WIDE, height: 0.0, plot: Rect::default(), groups: Vec::new() };
    heading(&mut scene, legend_of, sides);
    for chart in panels {
        panel(&mut scene, chart, sides, PANEL_HEIGHT);
    }
    scene
}

/// Left end and width of the plots in pixels.
#[derive(Clone, Copy)]
pub(super) struct Sides {
    pub(super) left: f64,
    pub(super) width: f64,
}

impl Sides {
    /// Reserves room for the widest axis labels of `charts` in a picture of this `width`.
    fn of(charts: &[Chart], width: f64) -> Self {
        let lefts = charts.iter().map(|chart| vertical_axis_width(&chart.left));
        let rights = charts.iter().filter_map(|chart| chart.right.as_ref());
        let left = MARGIN + lefts.fold(0.0, f64::max);
        let right = rights.map(vertical_axis_width).fold(0.0, f64::max);
        Self { left, width: width - left - MARGIN - right.max(8.0) }
    }
}

/// Begins `scene` with the title and the legend of `chart`.
pub(super) fn heading(scene: &mut Scene, chart: &Chart, sides: Sides) {
    let mut title = Text::new(sides.left, MARGIN + 16.0, &*chart.title, 17, Anchor::Start);
    title.weight = Weight::Bold;
    let top = MARGIN + 28.0;
    let entries = legend::place(legend::keys(chart), sides.left, top, sides.width);
    let marks = std::iter::once(Mark::Text(title)).chain(legend::marks(&entries)).collect();
    scene.groups.push(MarkGroup { kind: GroupKind::Heading, plot: Rect::default(), marks });
    scene.height = top + legend::height(&entries, top) + 6.0;
}

/// Adds one plot with its axes below the existing content of `scene`.
pub(super) fn panel(scene: &mut Scene, chart: &Chart, Sides { left, width }: Sides, height: f64) {
    let rule_labels = rule_rows(chart, Sides { left, width }, scene.width);
    let top = scene.height + height_of(&rule_labels) + 6.0;
    let plot = Rect { x: left, y: top, width, height };
    let picture = scene.width;
    let mut add = |kind, marks| scene.groups.push(MarkGroup { kind, plot, marks });
    add(GroupKind::Axis("x"), horizontal_axis(&chart.x, plot, picture));
    add(GroupKind::Axis("left"), vertical_axis(&chart.left, plot, Edge::Left));
    if let Some(axis) = &chart.right {
        add(GroupKind::Axis("right"), vertical_axis(axis, plot, Edge::Right));
    }
    add(GroupKind::Rules, rules(chart, &rule_labels, plot));
    let mut diverging = 0;
    for (index, series) in chart.series.iter().enumerate() {
        let y = match (series.side, &chart.right) {
            (Side::Right, Some(axis)) => &axis.scale,
            _ => &chart.left.scale,
        };
        let placing = Placing {
            x: &chart.x.scale,
            y,
            plot,
            diverged_y: plot.y + 9.0 + 11.0 * f64::from(diverging),
        };
        diverging += i32::from(series.points.iter().any(|point| point.y.is_infinite()));
        add(GroupKind::Series(index), placing.marks(series));
    }
    scene.plot = plot;
    let rows = (name_rows(&chart.x, plot.width) - 1) as f64 * NAME_ROW;
    let below = if chart.x.label.is_empty() { BELOW_UNLABELLED + rows } else { BELOW };
    scene.height = plot.bottom() + below;
}

/// Text above a vertical line, in a row where it covers no other text. Row 0 is nearest to the plot.
struct RuleLabel {
    /// Middle of the text in pixels.
    x: f64,
    /// Half of its width in pixels.
    half: f64,
    row: usize,
}

/// Returns the room for the text above the vertical lines of `chart`, in a `picture` of this width.
pub(super) fn rule_height(chart: &Chart, sides: Sides, picture: f64) -> f64 {
    height_of(&rule_rows(chart, sides, picture))
}

fn height_of(labels: &[RuleLabel]) -> f64 {
    labels.iter().map(|label| label.row + 1).max().unwrap_or(0) as f64 * RULE_ROW
}

fn rule_rows(chart: &Chart, Sides { left, width }: Sides, picture: f64) -> Vec<RuleLabel> {
    let mut labels: Vec<RuleLabel> = Vec::with_capacity(chart.rules.len());
    for rule in &chart.rules {
        let half = text_width(&rule.label, RULE_SIZE) / 2.0;
        let line = left + chart.x.scale.fraction(rule.x) * width;
        // In a narrow picture the text may begin left of the plot, over the axis.
        let from = if picture < WIDE { 2.0 } else { left };
        let middle = picture / 2.0;
        let x = line.clamp((from + half).min(middle), (picture - MARGIN - half).max(middle));
        let mut rows = 0..chart.rules.len();
        let free = rows.find(|&row| {
            !labels.iter().any(|other| {
                other.row == row
                    && x - half < other.x + other.half + 8.0
                    && other.x - other.half - 8.0 < x + half
            })
        });
        labels.push(RuleLabel { x, half, row: free.unwrap_or(0) });
    }
    labels
}

fn rules(chart: &Chart, labels: &[RuleLabel], plot: Rect) -> Vec<Mark> {
    let mut marks = Vec::with_capacity(2 * labels.len());
    for (rule, label) in chart.rules.iter().zip(labels) {
        let x = plot.x + chart.x.scale.fraction(rule.x) * plot.width;
        let baseline = plot.y - 6.0 - label.row as f64 * RULE_ROW;
        marks.push(Mark::Line {
            points: vec![(x, plot.y - 3.0 - label.row as f64 * RULE_ROW), (x, plot.bottom())],
            colour: Colour::Muted,
            width: 1.3,
            dash: rule.dash,
        });
        marks.push(Mark::Text(Text::new(
            label.x,
            baseline,
            &*rule.label,
            RULE_SIZE,
            Anchor::Middle,
        )));
    }
    marks
}

/// Conversion from the points of a curve to pixels.
struct Placing<'a> {
    x: &'a Scale,
    y: &'a Scale,
    plot: Rect,
    /// Height of diverged values. Each curve has its own row at the upper edge.
    diverged_y: f64,
}

impl Placing<'_> {
    fn pixel(&self, x: f64, y: f64) -> (f64, f64) {
        // Huge coordinates cause errors in viewers. The plot is clipped anyway.
        let up = self.y.fraction(y).clamp(-2.0, 3.0);
        (
            self.plot.x + self.x.fraction(x) * self.plot.width,
            self.plot.bottom() - up * self.plot.height,
        )
    }

    fn marks(&self, series: &Series) -> Vec<Mark> {
        let Series { colour, width, dash, .. } = *series;
        let mut marks = Vec::new();
        for run in series.points.split(|point| !point.y.is_finite()).filter(|run| !run.is_empty()) {
            marks.extend(self.intervals(run, colour, dash));
            let points = run.iter().map(|point| self.pixel(point.x, point.y)).collect();
            marks.push(Mark::Line { points, colour, width, dash });
        }
        for point in &series.points {
            if point.y.is_infinite() {
                let x = self.plot.x + self.x.fraction(point.x) * self.plot.width;
                let marker = Marker::Cross;
                marks.push(Mark::Symbol { x, y: self.diverged_y, marker, colour });
            } else if let (Some(marker), false) = (series.marker, point.y.is_nan()) {
                let (x, y) = self.pixel(point.x, point.y);
                marks.push(Mark::Symbol { x, y, marker, colour });
            }
        }
        marks
    }

    /// Draws the intervals: a band behind dense, unbroken curves, and whiskers with caps on sparse curves. A band shows
    /// the shape, and whiskers show where the curve was measured.
    fn intervals(&self, run: &[Point], colour: Colour, dash: Dash) -> Vec<Mark> {
        let ends: Vec<(f64, f64, f64)> =
            run.iter().filter_map(|p| p.interval.map(|(low, high)| (p.x, low, high))).collect();
        let is_dense = ends.len() > BAND_ABOVE_POINTS;
        let mut marks = Vec::new();
        if is_dense || (dash == Dash::Solid && ends.len() > 1) {
            let lower = ends.iter().map(|&(x, low, _)| self.pixel(x, low));
            let upper = ends.iter().rev().map(|&(x, _, high)| self.pixel(x, high));
            marks.push(Mark::Area { points: lower.chain(upper).collect(), colour });
        }
        if is_dense {
            return marks;
        }
        marks.extend(ends.iter().flat_map(|&(x, low, high)| {
            let ((x, bottom), (_, top)) = (self.pixel(x, low), self.pixel(x, high));
            let whisker = [(x, bottom), (x, top)];
            let caps = [bottom, top].map(|y| [(x - 4.0, y), (x + 4.0, y)]);
            [whisker, caps[0], caps[1]].map(|ends| Mark::Line {
                points: ends.to_vec(),
                colour,
                width: 1.4,
                dash: Dash::Solid,
            })
        }));
        marks
    }
}
