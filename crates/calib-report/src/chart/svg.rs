//! Painting of a scene as SVG text.

use std::fmt::Write;

use super::legend::{Key, SAMPLE, sample};
use super::scene::{
    Anchor, CIRCLE_RADIUS, GroupKind, Mark, MarkGroup, Rect, Scene, Text, Weight, outline,
};
use super::{Colour, Marker};

const FONT: &str = "'DejaVu Sans', Verdana, 'Segoe UI', Helvetica, Arial, sans-serif";

/// Paints `scene` as an SVG element. `id` must be unique in its document.
///
/// Colours are attributes, so that the file stands alone, and classes, so that a style sheet can override them.
pub(crate) fn svg(scene: &Scene, id: &str, title: &str, description: &str) -> String {
    let width = scene.width.round();
    let height = scene.height.round();
    let mut out = String::new();
    // Writing to a String cannot fail.
    let _ = write!(
        out,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" \
         height=\"{height}\" role=\"img\" aria-labelledby=\"{id}-title {id}-desc\" font-family=\"{FONT}\">\
         <title id=\"{id}-title\">{}</title><desc id=\"{id}-desc\">{}</desc>\
         <rect class=\"surface\" width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>",
        escaped(title),
        escaped(description),
    );
    let mut clips: Vec<Rect> = Vec::new();
    for group in &scene.groups {
        if matches!(group.kind, GroupKind::Series(_)) && clips.last() != Some(&group.plot) {
            write_clip(&mut out, group.plot, id, clips.len());
            clips.push(group.plot);
        }
        write_group(&mut out, group, id, clips.len().saturating_sub(1));
    }
    out.push_str("</svg>");
    out
}

/// Writes clip path number `number`: the plot, with room for symbols at its ends.
fn write_clip(out: &mut String, plot: Rect, id: &str, number: usize) {
    let x = tenths(plot.x - 7.0);
    let y = tenths(plot.y);
    let width = tenths(plot.width + 14.0);
    let height = tenths(plot.height);
    let _ = write!(
        out,
        "<clipPath id=\"{id}-clip{number}\"><rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\"/></clipPath>"
    );
}

fn write_group(out: &mut String, group: &MarkGroup, id: &str, clip: usize) {
    if group.marks.is_empty() {
        return;
    }
    let _ = match group.kind {
        GroupKind::Axis(name) => write!(out, "<g class=\"axis {name}\">"),
        GroupKind::Heading => write!(out, "<g class=\"heading\">"),
        GroupKind::Rules => write!(out, "<g class=\"rules\">"),
        GroupKind::Series(index) => {
            write!(
                out,
                "<g class=\"series\" data-series=\"{index}\" clip-path=\"url(#{id}-clip{clip})\">"
            )
        }
    };
    // When the page zooms, lines and areas are scaled and symbols only move. So they are separate groups.
    let (symbols, others): (Vec<&Mark>, Vec<&Mark>) =
        group.marks.iter().partition(|mark| matches!(mark, Mark::Symbol { .. }));
    let scaled = matches!(group.kind, GroupKind::Series(_));
    out.push_str(if scaled { "<g class=\"scaled\">" } else { "" });
    write_marks(out, others);
    out.push_str(if scaled { "</g>" } else { "" });
    write_marks(out, symbols);
    out.push_str("</g>");
}

fn write_marks<'a>(out: &mut String, marks: impl IntoIterator<Item = &'a Mark>) {
    for mark in marks {
        write_mark(out, mark);
    }
}

fn write_mark(out: &mut String, mark: &Mark) {
    match mark {
        Mark::Line { points, colour, width, dash } => {
            let hex = colour.hex();
            let class = colour.class();
            let _ = write!(
                out,
                "<path class=\"line {class}\" d=\"{}\" fill=\"none\" stroke=\"{hex}\" stroke-width=\"{width}\" \
                 stroke-linejoin=\"round\" vector-effect=\"non-scaling-stroke\"",
                path(points)
            );
            if let Some((ink, gap)) = dash.lengths() {
                let _ = write!(out, " stroke-dasharray=\"{ink} {gap}\"");
            }
            out.push_str("/>");
        }
        Mark::Area { points, colour } => {
            let hex = colour.hex();
            let class = colour.class();
            let _ = write!(
                out,
                "<path class=\"area {class}\" d=\"{}z\" fill=\"{hex}\" fill-opacity=\"0.18\"/>",
                path(points)
            );
        }
        Mark::Symbol { x, y, marker, colour } => write_symbol(out, (*x, *y), *marker, *colour),
        Mark::Text(text) => write_text(out, text),
    }
}

fn write_symbol(out: &mut String, (x, y): (f64, f64), marker: Marker, colour: Colour) {
    let hex = colour.hex();
    let class = colour.class();
    let x = tenths(x);
    let y = tenths(y);
    let look = format!("class=\"symbol {class}\" transform=\"translate({x} {y})\" fill=\"{hex}\"");
    let _ = match marker {
        Marker::Circle => write!(out, "<circle {look} r=\"{CIRCLE_RADIUS}\"/>"),
        Marker::Cross => {
            let look = look.replacen("symbol", "symbol cross", 1);
            write!(out, "<path {look} d=\"{}z\"/>", path(&outline(marker)))
        }
        other => write!(out, "<path {look} d=\"{}z\"/>", path(&outline(other))),
    };
}

fn write_text(out: &mut String, text: &Text) {
    let anchor = match text.anchor {
        Anchor::Start => "start",
        Anchor::Middle => "middle",
        Anchor::End => "end",
    };
    let x = tenths(text.x);
    let y = tenths(text.y);
    let _ = write!(
        out,
        "<text class=\"{}\" x=\"{x}\" y=\"{y}\" font-size=\"{}\" text-anchor=\"{anchor}\" fill=\"{}\"",
        text.colour.class(),
        text.size,
        text.colour.hex(),
    );
    if text.weight == Weight::Bold {
        out.push_str(" font-weight=\"bold\"");
    }
    if let Some(degrees) = text.turn.degrees() {
        let _ = write!(out, " transform=\"rotate({degrees} {x} {y})\"");
    }
    let _ = write!(out, ">{}</text>", escaped(&text.content));
}

/// Draws the line and marker of `key` as a small picture, for a legend outside the chart.
pub(crate) fn sample_svg(key: &Key) -> String {
    let mut out = format!(
        "<svg class=\"sample\" viewBox=\"0 0 {SAMPLE} 14\" width=\"{SAMPLE}\" height=\"14\" aria-hidden=\"true\">"
    );
    write_marks(&mut out, &sample(key, 0.0, 7.0));
    out.push_str("</svg>");
    out
}

/// Returns path data in tenths of a pixel, relative after the first point: short, and equal on every platform.
fn path(points: &[(f64, f64)]) -> String {
    let mut out = String::with_capacity(8 * points.len());
    let mut previous: Option<(i64, i64)> = None;
    for &(x, y) in points {
        let x = whole_tenths(x);
        let y = whole_tenths(y);
        match previous {
            None => {
                let _ = write!(out, "M{} {}", short(x), short(y));
            }
            // A repeated pixel adds nothing to the line.
            Some(last) if last == (x, y) => continue,
            Some((last_x, last_y)) => {
                let _ = write!(out, "l{} {}", short(x - last_x), short(y - last_y));
            }
        }
        previous = Some((x, y));
    }
    out
}

/// Formats `tenths` / 10 without trailing zeros.
fn short(tenths: i64) -> String {
    let sign = if tenths < 0 { "-" } else { "" };
    let size = tenths.unsigned_abs();
    match size % 10 {
        0 => format!("{sign}{}", size / 10),
        digit if size < 10 => format!("{sign}.{digit}"),
        digit => format!("{sign}{}.{digit}", size / 10),
    }
}

fn whole_tenths(value: f64) -> i64 {
    (value * 10.0).round() as i64
}

fn tenths(value: f64) -> String {
    short(whole_tenths(value))
}

/// Escapes the five characters of `text` that have a meaning in markup.
pub(crate) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            // XML does not allow control characters.
            c if c.is_control() && !matches!(c, '\n' | '\t' | '\r') => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_short_and_rounding_does_not_add_up() {
        let points: Vec<(f64, f64)> = (0..4).map(|i| (f64::from(i) * 0.34, 10.0)).collect();
        assert_eq!(path(&points), "M0 10l.3 0l.4 0l.3 0");
        assert_eq!(path(&[(1.0, 1.0), (1.0, 1.01), (0.0, -2.5)]), "M1 1l-1 -3.5");
    }

    #[test]
    fn markup_in_text_is_escaped() {
        assert_eq!(
            escaped("<b> & \"x\" 'y'\u{1}"),
            "&lt;b&gt; &amp; &quot;x&quot; &#39;y&#39;\u{fffd}"
        );
    }
}
