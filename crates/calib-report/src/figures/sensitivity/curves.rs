//! The curves of a sensitivity figure.

use calib_stats::Summary;

use super::{ErrorCurve, ErrorSource, RankCurve, Sensitivity};
use crate::chart::{Colour, Dash, Marker, Point, Series, Side};

/// Extra width of a rank curve per curve that is drawn after it, in pixels.
const WIDER: f64 = 2.2;

impl Sensitivity {
    /// Returns the error curves, then the rank curves. Points run from left
    /// to right, whatever the order of the grid.
    pub(super) fn curves(&self, positions: &[f64]) -> Vec<Series> {
        let mut order: Vec<usize> = (0..positions.len()).collect();
        order.sort_by(|&a, &b| positions[a].total_cmp(&positions[b]));
        let scores = self.errors.iter().enumerate().map(|(index, curve)| {
            let before = &self.errors[..index];
            let alike = before.iter().filter(|other| other.source == curve.source).count();
            score_series(
                curve,
                alike,
                order
                    .iter()
                    .map(|&place| score_point(positions[place], curve.summaries[place].as_ref()))
                    .collect(),
            )
        });
        let mut curves: Vec<Series> = scores.collect();
        let side = if self.errors.is_empty() { Side::Left } else { Side::Right };
        curves.extend(self.worst_ranks.iter().enumerate().map(|(index, curve)| {
            let after = self.worst_ranks.len() - 1 - index;
            rank_series(
                curve,
                [index, after],
                side,
                order
                    .iter()
                    .map(|&place| Point {
                        x: positions[place],
                        y: curve.worst_ranks[place] as f64,
                        interval: None,
                    })
                    .collect(),
            )
        }));
        curves
    }
}

/// Returns an error curve. `alike` is the number of earlier curves from the same kind of environment.
fn score_series(curve: &ErrorCurve, alike: usize, points: Vec<Point>) -> Series {
    let (colour, dash, width, marker) = match curve.source {
        ErrorSource::Online => (Colour::Curve(0), Dash::Solid, 2.6, Some(Marker::Circle)),
        ErrorSource::LogReplay => (Colour::Muted, Dash::Dotted, 1.8, Some(Marker::TriangleDown)),
        ErrorSource::Simple => (Colour::Muted, Dash::Dashed, 1.6, None),
        // The colours after that of the held-out period belong to the ensembles.
        ErrorSource::Model => (Colour::Curve(3 + alike), Dash::Solid, 1.8, Some(Marker::Triangle)),
        // Same colour as the ranks of the ensemble.
        ErrorSource::Evidence => {
            (Colour::Curve(1 + alike), Dash::Solid, 1.8, Some(Marker::Triangle))
        }
    };
    let label = curve.label.clone();
    Series { label, side: Side::Left, colour, dash, width, marker, points }
}

/// Returns a rank curve. Ranks are whole, so curves often coincide. Those drawn first are wider, and stay visible.
fn rank_series(
    curve: &RankCurve,
    [index, after]: [usize; 2],
    side: Side,
    points: Vec<Point>,
) -> Series {
    let marker = Some([Marker::Square, Marker::Diamond, Marker::Circle][index % 3]);
    let label = curve.label.clone();
    let colour = Colour::Curve(1 + index);
    let width = 1.8 + WIDER * after.min(3) as f64;
    let dash = if index.is_multiple_of(2) { Dash::Dashed } else { Dash::Dotted };
    Series { label, side, colour, dash, width, marker, points }
}

fn score_point(x: f64, summary: Option<&Summary>) -> Point {
    let interval = summary.and_then(|summary| summary.interval).map(|ends| (ends.low, ends.high));
    Point { x, y: summary.map_or(f64::NAN, |summary| summary.mean), interval }
}
