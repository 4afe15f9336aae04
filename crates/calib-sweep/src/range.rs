use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::points::{Interval, Points, Scale, decimals};

/// A range of numbers, ends included.
///
/// With `per_decade`, `count` or `step` it is a list of values. Without any of these it is all numbers
/// between its ends, from which random and Sobol sampling draw. Values other than the ends are rounded: to
/// three significant digits (log), or to three more decimals than the spacing has (linear). They are whole
/// numbers if the field needs whole numbers, or if `whole` is true.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Range {
    /// The lowest value.
    pub from: f64,
    /// The highest value.
    pub to: f64,
    /// `"linear"` (default) or `"log"`; `per_decade` means `"log"`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<Scale>,
    /// Values from `from` to `to` in steps of the factor `10^(1 / per_decade)`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub per_decade: Option<usize>,
    /// Number of values from `from` to `to`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub count: Option<usize>,
    /// Values from `from` to `to` in steps of this difference.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<f64>,
    /// Whether to use only whole numbers, even if the field takes others.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub whole: bool,
}

/// Limit on the values of one field, larger than any practical grid.
const MANY_VALUES: usize = 10_000;

/// Tolerance for rounding at the end of a decade or step.
const SLACK: f64 = 1e-9;

impl Range {
    /// Returns the values of the range. `whole` says that the field takes whole numbers. The error says what
    /// is wrong with the range.
    pub(crate) fn points(&self, whole: bool) -> Result<Points, String> {
        let Self { from, to, .. } = *self;
        let whole = whole || self.whole;
        let interval = Interval { from, to, scale: self.scale()?, whole };
        interval.check()?;
        let values: Vec<f64> = match (self.per_decade, self.count, self.step) {
            (None, None, None) => return Ok(Points::Continuous(interval)),
            (Some(0), ..) => return Err("per_decade must be at least 1".to_owned()),
            (Some(per_decade), None, None) => {
                let per_decade = per_decade as f64;
                let steps = ((to / from).log10() * per_decade + SLACK).floor();
                let steps = checked_count(steps + 1.0)? - 1;
                (0..=steps)
                    .map(|i: usize| interval.rounded(from * 10_f64.powf(i as f64 / per_decade)))
                    .collect()
            }
            (None, Some(count), None) => {
                let last = (checked_count(count as f64)? - 1) as f64;
                (0..count).map(|i| interval.rounded(interval.at(i as f64 / last))).collect()
            }
            (None, None, Some(step)) => {
                if step.is_nan() || step <= 0.0 || (whole && step.fract() != 0.0) {
                    let kind = if whole { "a whole number above 0" } else { "above 0" };
                    return Err(format!("step must be {kind}, got {step}"));
                }
                let steps = checked_count(((to - from) / step + SLACK).floor() + 1.0)? - 1;
                (0..=steps)
                    .map(|i: usize| decimals(from + i as f64 * step, step).clamp(from, to))
                    .collect()
            }
            _ => return Err("give one of per_decade, count and step".to_owned()),
        };
        Ok(Points::Discrete(values.into_iter().map(|value| interval.value(value)).collect()))
    }

    fn scale(&self) -> Result<Scale, String> {
        match (self.scale, self.per_decade, self.step) {
            (Some(Scale::Linear), Some(_), _) => Err("per_decade needs scale = \"log\"".to_owned()),
            (Some(Scale::Log), _, Some(_)) => {
                Err("step needs scale = \"linear\"; give per_decade or count".to_owned())
            }
            (None, Some(_), _) => Ok(Scale::Log),
            (scale, ..) => Ok(scale.unwrap_or(Scale::Linear)),
        }
    }
}

/// Checks that a range has neither too few nor too many values, and returns their number.
fn checked_count(count: f64) -> Result<usize, String> {
    // Compared before the cast, because quotients of distant numbers are infinite.
    if (2.0..=MANY_VALUES as f64).contains(&count) {
        Ok(count as usize)
    } else {
        Err(format!("it must have 2 to {MANY_VALUES} values, this one has {count}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn range(text: &str) -> Range {
        serde_json::from_str(text).expect("a range")
    }

    fn list(text: &str, whole: bool) -> Vec<f64> {
        match range(text).points(whole).expect("valid") {
            Points::Discrete(values) => {
                assert!(values.iter().all(|value| value.is_u64() == whole));
                values.iter().map(|value| value.as_f64().expect("a number")).collect()
            }
            Points::Continuous(interval) => panic!("{interval:?}"),
        }
    }

    #[test]
    fn ranges_are_what_one_would_write_by_hand() {
        assert_eq!(
            list(r#"{"from": 1e-4, "to": 1e-2, "per_decade": 2}"#, false),
            [1e-4, 3.16e-4, 1e-3, 3.16e-3, 1e-2]
        );
        assert_eq!(
            list(r#"{"from": 1e-6, "to": 5e-5, "per_decade": 1}"#, false),
            [1e-6, 1e-5],
            "as far as the end"
        );
        assert_eq!(
            list(r#"{"from": 1e-6, "to": 1e-2, "scale": "log", "count": 3}"#, false),
            [1e-6, 1e-4, 1e-2]
        );
        assert_eq!(
            list(r#"{"from": 0.9, "to": 0.99, "count": 4}"#, false),
            [0.9, 0.93, 0.96, 0.99]
        );
        assert_eq!(list(r#"{"from": 0, "to": 0.3, "step": 0.1}"#, false), [0.0, 0.1, 0.2, 0.3]);
        assert_eq!(
            list(r#"{"from": 64, "to": 256, "step": 64}"#, true),
            [64.0, 128.0, 192.0, 256.0]
        );
        assert_eq!(
            list(r#"{"from": 32, "to": 512, "scale": "log", "count": 5}"#, true),
            [32.0, 64.0, 128.0, 256.0, 512.0]
        );
    }

    fn mistake(text: &str, whole: bool) -> String {
        range(text).points(whole).expect_err("invalid")
    }

    #[test]
    fn mistakes_say_what_to_do() {
        assert!(
            mistake(r#"{"from": 2, "to": 1, "count": 3}"#, false).contains("from must be below to")
        );
        assert!(
            mistake(r#"{"from": 0, "to": 1, "per_decade": 2}"#, false).contains("begin above 0")
        );
        assert!(
            mistake(r#"{"from": 1, "to": 2, "count": 1}"#, false).contains("2 to 10000 values")
        );
        assert!(mistake(r#"{"from": 1, "to": 2, "step": 1e-9}"#, false).contains("2 to 10000"));
        assert!(mistake(r#"{"from": 1, "to": 2, "step": 0.5}"#, true).contains("whole number"));
        assert!(mistake(r#"{"from": 1.5, "to": 2, "count": 2}"#, true).contains("whole numbers"));
        assert!(
            mistake(r#"{"from": 1, "to": 2, "count": 3, "step": 1}"#, false).contains("one of")
        );
        let scales = r#"{"from": 1, "to": 2, "scale": "linear", "per_decade": 1}"#;
        assert!(mistake(scales, false).contains("scale = \"log\""));
        assert!(serde_json::from_str::<Range>(r#"{"from": 1}"#).is_err());
    }

    #[test]
    fn draws_stay_inside_and_reach_both_ends() {
        for (text, whole) in [
            (r#"{"from": 0.123456, "to": 0.123789}"#, false),
            (r#"{"from": 1.2345e-5, "to": 9.8765e-2, "scale": "log"}"#, false),
            (r#"{"from": 3, "to": 6}"#, true),
            (r#"{"from": 3, "to": 600, "scale": "log"}"#, true),
        ] {
            let range = range(text);
            let Points::Continuous(interval) = range.points(whole).expect("valid") else {
                panic!("{text}")
            };
            let draws: Vec<f64> = (0..1000).map(|i| interval.draw(f64::from(i) / 1000.0)).collect();
            assert!(draws.iter().all(|draw| (range.from..=range.to).contains(draw)), "{text}");
            assert!(draws.is_sorted(), "{text}");
            assert_eq!(draws[0], range.from);
            assert!(draws[999] > range.from + 0.98 * (range.to - range.from), "{text}");
        }
    }
}
