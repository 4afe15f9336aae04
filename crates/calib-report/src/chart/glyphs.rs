//! Text as outlines of compiled-in fonts: figures look the same everywhere, on machines without fonts too.

use std::{io::Read, sync::OnceLock};

use flate2::read::GzDecoder;
use tiny_skia::{Path, PathBuilder, Transform};
use ttf_parser::{Face, GlyphId, OutlineBuilder};

use super::scene::{Anchor, Text, Weight};

/// The font `DejaVu` Sans (`assets/fonts/LICENSE`), compressed.
const REGULAR: &[u8] = include_bytes!("../../assets/fonts/DejaVuSans.ttf.gz");
const BOLD: &[u8] = include_bytes!("../../assets/fonts/DejaVuSans-Bold.ttf.gz");

/// Returns the outlines of `text` at its position, in pixels of the layout.
/// `None` for text without outlines, such as spaces.
pub(super) fn outlines(text: &Text) -> Option<Path> {
    let face = face(text.weight)?;
    let scale = text.size as f32 / f32::from(face.units_per_em());
    let mut pen = Pen { path: PathBuilder::new(), x: 0.0, scale };
    for letter in text.content.chars() {
        // The font has a box for letters that it lacks.
        let glyph = face.glyph_index(letter).unwrap_or(GlyphId(0));
        face.outline_glyph(glyph, &mut pen);
        pen.x += scale * f32::from(face.glyph_hor_advance(glyph).unwrap_or(0));
    }
    let share = match text.anchor {
        Anchor::Start => 0.0,
        Anchor::Middle => 0.5,
        Anchor::End => 1.0,
    };
    let place = Transform::from_translate(-share * pen.x, 0.0)
        .post_rotate(text.turn.degrees().unwrap_or(0.0) as f32)
        .post_translate(text.x as f32, text.y as f32);
    pen.path.finish()?.transform(place)
}

/// Returns the font of this weight. Fonts are decompressed once.
fn face(weight: Weight) -> Option<Face<'static>> {
    static UNPACKED: [OnceLock<Vec<u8>>; 2] = [const { OnceLock::new() }; 2];
    let (place, packed) = match weight {
        Weight::Regular => (0, REGULAR),
        Weight::Bold => (1, BOLD),
    };
    let font = UNPACKED[place].get_or_init(|| {
        let mut font = Vec::new();
        // A damaged font draws nothing. The tests would find it.
        let _ = GzDecoder::new(packed).read_to_end(&mut font);
        font
    });
    Face::parse(font, 0).ok()
}

/// Writes glyphs side by side. Their y axis points upwards, in units of the font.
struct Pen {
    path: PathBuilder,
    x: f32,
    scale: f32,
}

impl Pen {
    fn at(&self, x: f32, y: f32) -> (f32, f32) {
        (self.x + self.scale * x, -self.scale * y)
    }
}

impl OutlineBuilder for Pen {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.path.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.path.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let (x1, y1) = self.at(x1, y1);
        let (x, y) = self.at(x, y);
        self.path.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let (x1, y1) = self.at(x1, y1);
        let (x2, y2) = self.at(x2, y2);
        let (x, y) = self.at(x, y);
        self.path.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.path.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chart::scene::Turn;

    fn bounds(content: &str, change: impl FnOnce(&mut Text)) -> Option<[f32; 4]> {
        let mut text = Text::new(100.0, 50.0, content, 20, Anchor::Start);
        change(&mut text);
        let bounds = outlines(&text)?.bounds();
        Some([bounds.left(), bounds.top(), bounds.right(), bounds.bottom()])
    }

    #[test]
    fn text_stands_where_its_anchor_says() {
        let [left, top, right, bottom] = bounds("HEH", |_| {}).expect("outlines");
        assert!((100.0..103.0).contains(&left), "{left}");
        assert!((top - 35.4).abs() < 0.1, "capitals are 0.729 of the size high: {top}");
        assert_eq!(bottom, 50.0, "on the line");
        let width = right - left;
        let [end_left, .., end_right, _] =
            bounds("HEH", |text| text.anchor = Anchor::End).expect("outlines");
        assert!((97.0..100.0).contains(&end_right), "{end_right}");
        assert!((end_right - end_left - width).abs() < 1e-3);
        let [left, _, right, _] =
            bounds("HEH", |text| text.anchor = Anchor::Middle).expect("outlines");
        assert!((f32::midpoint(left, right) - 100.0).abs() < 0.1, "{left} {right}");
    }

    #[test]
    fn text_turns_around_its_anchor() {
        let [left, top, right, bottom] =
            bounds("HEH", |text| text.turn = Turn::Upwards).expect("outlines");
        assert!(top < 20.0 && bottom < 50.0 && bottom > 47.0, "{top} {bottom}");
        assert!((right - 100.0).abs() < 1e-3 && (left - 85.4).abs() < 0.1, "{left} {right}");
        let [left, top, ..] = bounds("HEH", |text| text.turn = Turn::Downwards).expect("outlines");
        assert!(top > 50.0 && (left - 100.0).abs() < 1e-3, "{left} {top}");
    }

    fn width(content: &str, weight: Weight) -> f32 {
        let [left, _, right, _] = bounds(content, |text| text.weight = weight).expect("some");
        right - left
    }

    #[test]
    fn bold_is_wider_and_letters_of_no_font_are_boxes() {
        assert!(width("pressure", Weight::Bold) > width("pressure", Weight::Regular));
        assert!(width("γ°μ", Weight::Regular) > 20.0);
        assert!(width("\u{10fffd}", Weight::Regular) > 5.0);
        assert_eq!(bounds(" ", |_| {}), None);
    }
}
