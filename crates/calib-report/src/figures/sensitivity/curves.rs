//! The curves of a sensitivity figure.

use calib_stats::Summary;

use super::{ErrorCurve, ErrorSource, RankCurve, Sensitivity};
use crate::chart::{Colour, Dash, Marker, Point, Series, Side};

/// How much wider a curve of ranks is than the one that is drawn after it.
const WIDER: f64 = 2.2;

impl Sensitivity {
    /// Scores, then worst ranks; points from left to right, whatever the order of the grid.
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

/// `alike` is the number of curves from the same kind of environment before it.
fn score_series(curve: &ErrorCurve, alike: usize, points: Vec<Point>) -> Series {
    let (colour, dash, width, marker) = match curve.source {
        ErrorSource::Online => (Colour::Curve(0), Dash::Solid, 2.6, Some(Marker::Circle)),
        ErrorSource::LogReplay => (Colour::Muted, Dash::Dotted, 1.8, Some(Marker::TriangleDown)),
        ErrorSource::Simple => (Colour::Muted, Dash::Dashed, 1.6, None),
        // The first colours after Online's are those of the ensembles.
        ErrorSource::Model => (Colour::Curve(3 + alike), Dash::Solid, 1.8, Some(Marker::Triangle)),
        // The colour of the ensemble's ranks.
        ErrorSource::Evidence => {
            (Colour::Curve(1 + alike), Dash::Solid, 1.8, Some(Marker::Triangle))
        }
    };
    let label = curve.label.clone();
    Series { label, side: Side::Left, colour, dash, width, marker, points }
}

/// Ranks are whole, so that curves often lie on each other: those drawn before others are wider, and seen beside them.
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
