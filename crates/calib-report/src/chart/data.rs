//! Numbers of a chart, as JSON for the page's script.

use serde_json::{Value, json};

use super::packed::Detail;
use super::scene::Scene;
use super::{Axis, Chart, Point, ScaleKind, Side};

/// Significant digits of values. Horizontal positions have more, so that long series stay in order.
const VALUE_DIGITS: usize = 5;
const POSITION_DIGITS: usize = 8;

/// Returns the plot rectangles of the wide and the narrow scene of `chart`, its scales
/// and its points. The JSON is safe inside a script element.
///
/// A missing value is `null`, and an infinite value is `"diverged"`. Series i with a `details[i]` has all its values,
/// [packed](Detail::fields), instead of the drawn points.
pub(crate) fn chart_data(chart: &Chart, scenes: [&Scene; 2], details: &[Detail<'_>]) -> String {
    let plots = scenes.map(|scene| {
        let plot = scene.plot;
        [plot.x, plot.y, plot.width, plot.height].map(|side| (side * 10.0).round() / 10.0)
    });
    let series: Vec<Value> = chart
        .series
        .iter()
        .enumerate()
        .map(|(place, series)| {
            let points = &series.points;
            if let Some(detail) = details.get(place) {
                let scale = &chart.left.scale;
                let mut fields = detail.fields(scale.max - scale.min);
                fields.insert("label".to_owned(), json!(series.label));
                fields.insert("side".to_owned(), json!("left"));
                return Value::Object(fields);
            }
            let mut value = json!({
                "label": series.label,
                "side": match series.side { Side::Left => "left", Side::Right => "right" },
                "x": points.iter().map(|p| rounded(p.x, POSITION_DIGITS)).collect::<Vec<_>>(),
                "y": points.iter().map(|p| rounded(p.y, VALUE_DIGITS)).collect::<Vec<_>>(),
            });
            if points.iter().any(|point| point.interval.is_some()) {
                value["low"] = json!(interval_ends(points, |(low, _)| low));
                value["high"] = json!(interval_ends(points, |(_, high)| high));
            }
            value
        })
        .collect();
    let data = json!({
        "plots": plots,
        "x": axis(&chart.x),
        "left": axis(&chart.left),
        "right": chart.right.as_ref().map(axis),
        "series": series,
    });
    // A label with "</script>" must not end the element; JSON allows the escaped form.
    data.to_string().replace('<', "\\u003c")
}

/// Returns one end of the interval of each point, `null` for points without an interval.
fn interval_ends(points: &[Point], pick: fn((f64, f64)) -> f64) -> Vec<Value> {
    let intervals = points.iter().map(|point| point.interval);
    intervals
        .map(|interval| interval.map_or(Value::Null, |ends| rounded(pick(ends), VALUE_DIGITS)))
        .collect()
}

fn axis(axis: &Axis) -> Value {
    let scale = &axis.scale;
    let (kind, names) = match &scale.kind {
        ScaleKind::Linear | ScaleKind::Time | ScaleKind::CutTime(_) => ("linear", None),
        ScaleKind::Whole => ("whole", None),
        ScaleKind::Log => ("log", None),
        ScaleKind::Names(names) => ("names", Some(names)),
    };
    json!({ "label": axis.label, "kind": kind, "min": scale.min, "max": scale.max, "names": names })
}

fn rounded(value: f64, digits: usize) -> Value {
    if value.is_nan() {
        return Value::Null;
    }
    if value.is_infinite() {
        return json!("diverged");
    }
    let short = calib_core::rounded(value, digits);
    // Whole numbers have no ".0": there are thousands of them.
    if short.fract() == 0.0 && short.abs() < 1e15 { json!(short as i64) } else { json!(short) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_special_ones_are_named() {
        assert_eq!(rounded(0.123_456_789, 5), json!(0.12346));
        assert_eq!(rounded(30_000.0, 5), json!(30_000));
        assert_eq!(rounded(f64::NAN, 5), Value::Null);
        assert_eq!(rounded(f64::INFINITY, 5), json!("diverged"));
    }
}
