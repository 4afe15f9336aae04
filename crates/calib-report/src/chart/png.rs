//! Scene to PNG, through kuva's rasteriser and its embedded font.

use std::fmt::Write;

use kuva::backend::png::PngBackend;
use kuva::render::color::Color as KuvaColour;
use kuva::render::render::{PathData, Primitive, Scene as KuvaScene, TextAnchor, TextSpan};

use super::scene::{Anchor, CIRCLE_RADIUS, GroupKind, Mark, Rect, Scene, Text, Weight, outline};
use super::{Colour, Marker};
use crate::ReportError;

/// Pixels of the bitmap for each pixel of the layout.
const PIXEL_RATIO: f32 = 2.0;

const AREA_OPACITY: f64 = 0.18;

/// Paints `scene` as the bytes of a PNG file of twice its size.
pub(crate) fn png(scene: &Scene) -> Result<Vec<u8>, ReportError> {
    let mut target = KuvaScene::new(scene.width, scene.height);
    for group in &scene.groups {
        let clipped = matches!(group.kind, GroupKind::Series(_));
        if clipped {
            target.elements.push(clip_start(group.plot));
        }
        for mark in &group.marks {
            paint(&mut target.elements, mark);
        }
        if clipped {
            target.elements.push(Primitive::ClipEnd);
        }
    }
    PngBackend::new()
        .with_scale(PIXEL_RATIO)
        .render_scene(&target)
        .map_err(|reason| ReportError::Png { reason })
}

fn clip_start(plot: Rect) -> Primitive {
    // As in the SVG, symbols at the very ends of the axis stay whole.
    let (x, width) = (plot.x - 7.0, plot.width + 14.0);
    Primitive::ClipStart { x, y: plot.y, width, height: plot.height, id: String::new() }
}

fn paint(elements: &mut Vec<Primitive>, mark: &Mark) {
    match mark {
        Mark::Line { points, colour, width, dash } => {
            for points in dashes(points, dash.lengths()) {
                let (stroke, stroke_width) = (kuva_colour(*colour), *width);
                elements.push(Primitive::PolyLine {
                    points,
                    stroke,
                    stroke_width,
                    stroke_dasharray: None,
                });
            }
        }
        Mark::Area { points, colour } => {
            elements.push(polygon(points, (0.0, 0.0), *colour, Some(AREA_OPACITY)));
        }
        Mark::Symbol { x, y, marker: Marker::Circle, colour } => elements.push(Primitive::Circle {
            cx: *x,
            cy: *y,
            r: CIRCLE_RADIUS,
            fill: kuva_colour(*colour),
            fill_opacity: None,
            stroke: None,
            stroke_width: None,
        }),
        Mark::Symbol { x, y, marker, colour } => {
            elements.push(polygon(&outline(*marker), (*x, *y), *colour, None));
        }
        Mark::Text(text) => elements.push(text_primitive(text)),
    }
}

/// Cuts a line into its dashes. kuva would start the pattern anew at every point of the line.
fn dashes(points: &[(f64, f64)], lengths: Option<(f64, f64)>) -> Vec<Vec<(f64, f64)>> {
    let (Some((on, off)), Some(&first)) = (lengths, points.first()) else {
        return vec![points.to_vec()];
    };
    let (mut pieces, mut piece) = (Vec::new(), vec![first]);
    let (mut inked, mut left) = (true, on);
    for pair in points.windows(2) {
        let (mut from, to) = (pair[0], pair[1]);
        loop {
            let distance = (to.0 - from.0).hypot(to.1 - from.1);
            if distance < left {
                left -= distance;
                if inked {
                    piece.push(to);
                }
                break;
            }
            let share = left / distance;
            from = (from.0 + share * (to.0 - from.0), from.1 + share * (to.1 - from.1));
            piece.push(from);
            if inked {
                pieces.push(std::mem::take(&mut piece));
            } else {
                piece = vec![from];
            }
            (inked, left) = if inked { (false, off) } else { (true, on) };
        }
    }
    if inked && piece.len() > 1 {
        pieces.push(piece);
    }
    pieces
}

fn polygon(
    points: &[(f64, f64)],
    (x, y): (f64, f64),
    colour: Colour,
    opacity: Option<f64>,
) -> Primitive {
    let mut d = String::new();
    for (index, (dx, dy)) in points.iter().enumerate() {
        let command = if index == 0 { 'M' } else { 'L' };
        // Writing to a String cannot fail.
        let _ = write!(d, "{command}{:.2},{:.2} ", x + dx, y + dy);
    }
    d.push('Z');
    let fill = Some(kuva_colour(colour));
    let stroke = KuvaColour::None;
    Primitive::Path(Box::new(PathData {
        d,
        fill,
        stroke,
        stroke_width: 0.0,
        opacity,
        stroke_dasharray: None,
    }))
}

fn text_primitive(text: &Text) -> Primitive {
    let anchor = match text.anchor {
        Anchor::Start => TextAnchor::Start,
        Anchor::Middle => TextAnchor::Middle,
        Anchor::End => TextAnchor::End,
    };
    let (x, y, size) = (text.x, text.y, text.size);
    let color = Some(kuva_colour(text.colour));
    // kuva reads dollar signs as mathematics; ours are only dollars.
    let content = text.content.replace('$', "\\$");
    match text.weight {
        Weight::Bold => {
            let span = TextSpan { bold: true, ..TextSpan::plain(content) };
            Primitive::RichText { x, y, spans: vec![span], size, anchor, color }
        }
        Weight::Regular => {
            let rotate = text.turn.degrees();
            Primitive::Text { x, y, content, size, anchor, rotate, bold: false, color }
        }
    }
}

fn kuva_colour(colour: Colour) -> KuvaColour {
    KuvaColour::from(colour.hex())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dashes_carry_on_around_corners() {
        let line = [(0.0, 0.0), (5.0, 0.0), (5.0, 10.0)];
        let pieces = dashes(&line, Some((7.0, 4.0)));
        assert_eq!(
            pieces,
            [vec![(0.0, 0.0), (5.0, 0.0), (5.0, 2.0)], vec![(5.0, 6.0), (5.0, 10.0)]]
        );
        assert_eq!(dashes(&line, None), [line.to_vec()]);
    }
}
