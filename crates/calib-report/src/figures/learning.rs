//! Learning curves: the error of each setting along a training run.

use calib_stats::Summary;

use crate::chart::{Axis, Chart, Colour, Dash, ORDERED, Point, Scale, Series, Side, extent};
use crate::{Figure, LearningEnvironment, ReportError, Setting};

/// Learning curves of one sensor in one environment.
#[derive(Debug, Clone, PartialEq)]
pub struct LearningCurves {
    /// The predicted sensor.
    pub sensor: String,
    /// The swept hyperparameter, as in the study file.
    pub field: String,
    /// Environment in which the agents learned.
    pub environment: LearningEnvironment,
    /// Steps of a run.
    pub steps: usize,
    /// One curve per setting, in the order of the grid.
    pub curves: Vec<LearningCurve>,
}

/// Error of one setting against the step.
#[derive(Debug, Clone, PartialEq)]
pub struct LearningCurve {
    /// The setting.
    pub value: Setting,
    /// Points in the order of their steps: the step, and the error over the window that ends at it, summarised over runs.
    /// The mean is infinite from the first diverged run onwards.
    pub points: Vec<(usize, Summary)>,
}

impl LearningCurve {
    /// Returns the step by which a run had diverged, if any run did.
    pub(crate) fn diverged(&self) -> Option<usize> {
        self.points.iter().find(|(_, summary)| summary.mean.is_infinite()).map(|&(step, _)| step)
    }
}

impl LearningCurves {
    /// Returns the look of the curve at a position. Ordered numbers have a colour scale, and alternate between line patterns if
    /// neighbours would look alike. Other settings have six colours, then the same with dashes, then with dots.
    fn look(&self) -> impl Fn(usize) -> (Colour, Dash) + use<> {
        const DASHES: [Dash; 3] = [Dash::Solid, Dash::Dashed, Dash::Dotted];
        let numbers: Option<Vec<f64>> =
            self.curves.iter().map(|curve| curve.value.as_number()).collect();
        let is_ordered = numbers.is_some_and(|numbers| numbers.is_sorted_by(|a, b| a < b));
        let count = self.curves.len();
        let dashes = if count > ORDERED { DASHES.len() } else { 1 };
        move |place| {
            if is_ordered {
                (Colour::of_ordered(place, count), DASHES[place % dashes])
            } else {
                (Colour::Curve(place), DASHES[place / 6 % DASHES.len()])
            }
        }
    }

    /// Draws the figure: mean error against step, with 95 % intervals. The curve of a setting with a diverged run ends in a
    /// cross at the upper edge.
    ///
    /// # Errors
    ///
    /// If no curve has a point.
    pub fn figure(&self) -> Result<Figure, ReportError> {
        let title = format!("{}: learning curves, {}", self.sensor, self.environment);
        if self.curves.iter().all(|curve| curve.points.is_empty()) {
            return Err(ReportError::Empty { figure: title, missing: "points" });
        }
        let look = self.look();
        let series: Vec<Series> = self
            .curves
            .iter()
            .enumerate()
            .map(|(place, curve)| {
                let (colour, dash) = look(place);
                series(curve, colour, dash)
            })
            .collect();
        let means: Vec<f64> =
            series.iter().flat_map(|series| series.points.iter().map(|point| point.y)).collect();
        let scale = around(&means);
        let spacing = if scale.is_log() { ", log scale" } else { "" };
        let description = format!(
            "Error of the predictions of {} against step, for each {}, {}.",
            self.sensor, self.field, self.environment
        );
        let x = Axis { label: "step".to_owned(), scale: Scale::linear(0.0, self.steps as f64) };
        let left = Axis { label: format!("RMSE (normalised{spacing})"), scale };
        Ok(Figure::new(Chart { title, description, ..Chart::of(x, left, series) }))
    }
}

/// Returns the vertical scale. It ends at a thousand times the smallest error, so that a curve that explodes before it
/// diverges does not flatten all others.
fn around(means: &[f64]) -> Scale {
    let top = extent(means).map_or(f64::INFINITY, |(low, _)| 1e3 * low.max(f64::MIN_POSITIVE));
    Scale::around(&means.iter().map(|&mean| mean.min(top)).collect::<Vec<_>>())
}

fn series(curve: &LearningCurve, colour: Colour, dash: Dash) -> Series {
    let drawn = curve.points.iter().take_while(|(_, summary)| summary.mean.is_finite()).count();
    // The first infinite point becomes the cross.
    let points = &curve.points[..curve.points.len().min(drawn + 1)];
    Series {
        label: curve.value.to_string(),
        side: Side::Left,
        colour,
        dash,
        width: 1.6,
        marker: None,
        points: points
            .iter()
            .map(|&(step, ref summary): &(usize, Summary)| Point {
                x: step as f64,
                y: summary.mean,
                interval: summary.interval.map(|interval| (interval.low, interval.high)),
            })
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn looks(values: &[Setting]) -> Vec<(Colour, Dash)> {
        let curves = LearningCurves {
            sensor: "PIT300".to_owned(),
            field: "learning_rate".to_owned(),
            environment: LearningEnvironment::Member { number: 0, model: None },
            steps: 10,
            curves: values
                .iter()
                .map(|value| LearningCurve { value: value.clone(), points: Vec::new() })
                .collect(),
        };
        (0..values.len()).map(curves.look()).collect()
    }

    #[test]
    fn numbers_in_order_are_on_a_scale_and_others_are_not() {
        let numbers: Vec<Setting> = (0..3).map(|value| Setting::Number(f64::from(value))).collect();
        let steps = [Colour::Ordered(0), Colour::Ordered(4), Colour::Ordered(7)];
        assert_eq!(looks(&numbers), steps.map(|colour| (colour, Dash::Solid)));
        let names = ["adam", "sgd"].map(|name| Setting::Name(name.to_owned()));
        assert_eq!(looks(&names)[1], (Colour::Curve(1), Dash::Solid));
    }

    #[test]
    fn no_two_of_many_look_alike() {
        for count in 1..=20 {
            let numbers: Vec<Setting> =
                (0..count).map(|value| Setting::Number(f64::from(value))).collect();
            let looks = looks(&numbers);
            for (place, look) in looks.iter().enumerate() {
                assert!(!looks[..place].contains(look), "{count} values, {place}");
            }
        }
    }
}
