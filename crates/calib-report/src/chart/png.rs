//! Painting of a scene as PNG, with tiny-skia.

use tiny_skia::{
    Color, FillRule, LineJoin, Mask, Paint, Path, PathBuilder, Pixmap, Rect as SkiaRect, Stroke,
    StrokeDash, Transform,
};

use super::glyphs;
use super::scene::{CIRCLE_RADIUS, GroupKind, Mark, Rect, Scene, outline};
use super::{Colour, Marker};
use crate::ReportError;

/// Pixels of the bitmap per pixel of the layout.
const PIXEL_RATIO: f32 = 2.0;

const AREA_OPACITY: f32 = 0.18;

/// Paints `scene` as the bytes of a PNG file of twice its size.
pub(crate) fn png(scene: &Scene) -> Result<Vec<u8>, ReportError> {
    let mut canvas = Canvas::new(scene)?;
    for group in &scene.groups {
        let clip = match group.kind {
            GroupKind::Series(_) => canvas.clip(group.plot),
            _ => None,
        };
        for mark in &group.marks {
            canvas.paint(mark, clip.as_ref());
        }
    }
    encode(canvas.pixels)
}

struct Canvas {
    pixels: Pixmap,
}

impl Canvas {
    fn new(scene: &Scene) -> Result<Self, ReportError> {
        let [width, height] = [scene.width, scene.height]
            .map(|length| (length.round() * f64::from(PIXEL_RATIO)) as u32);
        let mut pixels = Pixmap::new(width, height).ok_or_else(|| ReportError::Png {
            reason: format!("{width} x {height} pixels are no picture"),
        })?;
        pixels.fill(Color::WHITE);
        Ok(Self { pixels })
    }

    /// Returns the clip mask of a plot. As in the SVG, symbols at the ends of the axis stay whole.
    fn clip(&self, plot: Rect) -> Option<Mask> {
        let x = plot.x as f32 - 7.0;
        let y = plot.y as f32;
        let rect = SkiaRect::from_xywh(x, y, plot.width as f32 + 14.0, plot.height as f32)?;
        let mut mask = Mask::new(self.pixels.width(), self.pixels.height())?;
        mask.fill_path(&PathBuilder::from_rect(rect), FillRule::Winding, true, scaled());
        Some(mask)
    }

    /// Paints a mark. Coordinates that are not finite have no path, and are left out.
    fn paint(&mut self, mark: &Mark, clip: Option<&Mask>) {
        match mark {
            Mark::Line { points, colour, width, dash } => {
                let dash = dash
                    .lengths()
                    .and_then(|(ink, gap)| StrokeDash::new(vec![ink as f32, gap as f32], 0.0));
                let width = *width as f32;
                let stroke =
                    Stroke { width, dash, line_join: LineJoin::Round, ..Stroke::default() };
                if let Some(path) = joined(points, (0.0, 0.0)).finish() {
                    let paint = paint_of(*colour, 1.0);
                    self.pixels.stroke_path(&path, &paint, &stroke, scaled(), clip);
                }
            }
            Mark::Area { points, colour } => {
                self.fill(closed(points, (0.0, 0.0)), *colour, AREA_OPACITY, clip);
            }
            Mark::Symbol { x, y, marker: Marker::Circle, colour } => {
                let circle = PathBuilder::from_circle(*x as f32, *y as f32, CIRCLE_RADIUS as f32);
                self.fill(circle, *colour, 1.0, clip);
            }
            Mark::Symbol { x, y, marker, colour } => {
                self.fill(closed(&outline(*marker), (*x, *y)), *colour, 1.0, clip);
            }
            Mark::Text(text) => self.fill(glyphs::outlines(text), text.colour, 1.0, clip),
        }
    }

    fn fill(&mut self, path: Option<Path>, colour: Colour, opacity: f32, clip: Option<&Mask>) {
        if let Some(path) = path {
            let paint = paint_of(colour, opacity);
            self.pixels.fill_path(&path, &paint, FillRule::Winding, scaled(), clip);
        }
    }
}

/// Returns the transform from the layout to the bitmap.
fn scaled() -> Transform {
    Transform::from_scale(PIXEL_RATIO, PIXEL_RATIO)
}

/// Returns a line through `points`, moved by an offset.
fn joined(points: &[(f64, f64)], (x, y): (f64, f64)) -> PathBuilder {
    let mut path = PathBuilder::new();
    for (index, (dx, dy)) in points.iter().enumerate() {
        let x = (x + dx) as f32;
        let y = (y + dy) as f32;
        if index == 0 {
            path.move_to(x, y);
        } else {
            path.line_to(x, y);
        }
    }
    path
}

fn closed(points: &[(f64, f64)], offset: (f64, f64)) -> Option<Path> {
    let mut path = joined(points, offset);
    path.close();
    path.finish()
}

fn paint_of(colour: Colour, opacity: f32) -> Paint<'static> {
    let [red, green, blue] = colour.rgb();
    let mut paint = Paint::default();
    paint.set_color_rgba8(red, green, blue, (255.0 * opacity).round() as u8);
    paint
}

/// Encodes the picture without transparency, because the page is white.
fn encode(pixels: Pixmap) -> Result<Vec<u8>, ReportError> {
    let width = pixels.width();
    let height = pixels.height();
    let colours: Vec<u8> =
        pixels.take().chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let written = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(&colours)?;
        writer.finish()
    });
    written.map_err(|error| ReportError::Png { reason: error.to_string() })?;
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chart::{Dash, scene::MarkGroup};

    /// Returns the pixel rows of a scene of 20 x 20 with one mark in
    /// the middle of a plot of 10 x 10.
    fn painted(kind: GroupKind, mark: Mark) -> Vec<[u8; 3]> {
        let plot = Rect { x: 8.0, y: 5.0, width: 4.0, height: 10.0 };
        let groups = vec![MarkGroup { kind, plot, marks: vec![mark] }];
        let scene = Scene { width: 20.0, height: 20.0, plot, groups };
        let bytes = png(&scene).expect("a picture");
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().expect("PNG");
        let mut pixels = vec![0; reader.output_buffer_size().expect("small")];
        reader.next_frame(&mut pixels).expect("whole");
        pixels.chunks_exact(3).map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect()
    }

    fn line(points: Vec<(f64, f64)>, dash: Dash) -> Mark {
        Mark::Line { points, colour: Colour::Ink, width: 2.0, dash }
    }

    /// Returns a line from the top to the bottom of the scene.
    fn across() -> Mark {
        line(vec![(10.0, 0.0), (10.0, 20.0)], Dash::Solid)
    }

    /// Returns the rows that have ink in the middle.
    fn dark(pixels: &[[u8; 3]]) -> Vec<usize> {
        (0..40).filter(|row| pixels[40 * row + 20] == [0x1b, 0x27, 0x33]).collect()
    }

    #[test]
    fn curves_end_with_their_plot_and_other_lines_do_not() {
        let free = painted(GroupKind::Rules, across());
        assert_eq!(dark(&free), (0..40).collect::<Vec<_>>());
        assert_eq!(free[17], [255; 3], "beside the line");
        let clipped = painted(GroupKind::Series(0), across());
        assert_eq!(dark(&clipped), (10..30).collect::<Vec<_>>());
    }

    fn is_inked(pixels: &[[u8; 3]], x: usize, y: usize) -> bool {
        pixels[40 * (2 * y) + 2 * x] == [0x1b, 0x27, 0x33]
    }

    #[test]
    fn dashes_carry_on_around_corners() {
        let corner = vec![(2.0, 2.0), (7.0, 2.0), (7.0, 18.0)];
        let pixels = painted(GroupKind::Rules, line(corner, Dash::Dashed));
        // Seven pixels of ink, five of them before the corner; four without; then seven of ink.
        assert!(is_inked(&pixels, 6, 2) && is_inked(&pixels, 7, 3));
        assert!(!is_inked(&pixels, 7, 5) && !is_inked(&pixels, 7, 7));
        assert!(is_inked(&pixels, 7, 9) && is_inked(&pixels, 7, 14) && !is_inked(&pixels, 7, 16));
    }

    #[test]
    fn areas_let_through_what_is_below_them_and_what_is_not_finite_is_left_out() {
        let square = vec![(6.0, 6.0), (14.0, 6.0), (14.0, 14.0), (6.0, 14.0)];
        let area = Mark::Area { points: square, colour: Colour::Curve(0) };
        let pixels = painted(GroupKind::Rules, area);
        assert_eq!(pixels[40 * 20 + 20], [209, 230, 241], "82 % of white");
        let nowhere = line(vec![(f64::NAN, 2.0), (7.0, 2.0)], Dash::Solid);
        assert!(painted(GroupKind::Rules, nowhere).iter().all(|pixel| *pixel == [255; 3]));
    }
}
