//! Sensitivity curves: how the error, and the models' worst rank, depend on a hyperparameter.

use calib_stats::{Direction, Summary};
use serde::{Deserialize, Serialize};

use crate::chart::{Axis, Chart, Colour, Dash, Marker, Point, Rule, Scale, Series, Side};
use crate::{Figure, ReportError, Setting};

/// What runs are judged by.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Score {
    /// Its name: "NRMSE".
    pub name: String,
    /// Which way it improves.
    pub direction: Direction,
}

impl Score {
    /// The paper's error: RMSE relative to the mean return; lower is better.
    pub fn nrmse() -> Self {
        Self { name: "NRMSE".to_owned(), direction: Direction::LowerIsBetter }
    }
}

/// One sensitivity figure, for one sensor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sensitivity {
    /// The predicted sensor.
    pub sensor: String,
    /// The swept hyperparameter, as in the study file: "`learning_rate`".
    pub field: String,
    /// What runs are judged by.
    pub score: Score,
    /// The grid, in its order.
    pub values: Vec<Setting>,
    /// Mean score and interval, read on the left axis.
    pub errors: Vec<ErrorCurve>,
    /// Worst rank of each calibration model, read on the right axis.
    pub worst_ranks: Vec<RankCurve>,
    /// Index of the value that is recommended.
    pub chosen: Option<usize>,
    /// Index of the value one would use without calib.
    pub default: Option<usize>,
}

/// Score against hyperparameter in one environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ErrorCurve {
    /// Name in the legend.
    pub label: String,
    /// Which environment it comes from.
    pub source: ErrorSource,
    /// Summary over runs, one for each value of the grid; `None` where nothing was run.
    pub summaries: Vec<Option<Summary>>,
}

/// Environments whose score is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ErrorSource {
    /// Held-out data, replayed: the truth the choice is judged by.
    Online,
    /// Training data, replayed: the cheap alternative to a calibration model.
    LogReplay,
    /// A calibration model that is no ensemble.
    Model,
}

/// Worst rank against hyperparameter in one ensemble.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RankCurve {
    /// Name of the calibration model.
    pub label: String,
    /// W, one for each value of the grid: 1 = best.
    pub worst_ranks: Vec<usize>,
}

impl Sensitivity {
    /// Draws the figure: a logarithmic horizontal axis where all values are positive numbers, mean score with
    /// 95 % whiskers on the left, worst rank on the right (on the left if there are no scores). Diverged values are crosses at the upper edge.
    ///
    /// # Errors
    ///
    /// The grid is empty, there is no curve, a curve does not have one point for each value,
    /// or a marked value is not in the grid.
    pub fn figure(&self) -> Result<Figure, ReportError> {
        let title = self.title();
        self.check(&title)?;
        let positions = self.positions();
        let mut series = Vec::new();
        let mut models = 0;
        for curve in &self.errors {
            let (colour, dash, marker) = match curve.source {
                ErrorSource::Online => (Colour::Curve(0), Dash::Solid, Marker::Circle),
                ErrorSource::LogReplay => (Colour::Muted, Dash::Dotted, Marker::TriangleDown),
                ErrorSource::Model => {
                    models += 1;
                    (Colour::Curve(2 + models), Dash::Solid, Marker::Triangle)
                }
            };
            let points = error_points(&positions, &curve.summaries);
            let width = if curve.source == ErrorSource::Online { 2.6 } else { 1.8 };
            let marker = Some(marker);
            let label = curve.label.clone();
            series.push(Series { label, side: Side::Left, colour, dash, width, marker, points });
        }
        for (index, curve) in self.worst_ranks.iter().enumerate() {
            let marker = [Marker::Square, Marker::Diamond, Marker::Circle][index % 3];
            let points = positions
                .iter()
                .zip(&curve.worst_ranks)
                .map(|(&x, &rank)| Point { x, y: rank as f64, interval: None })
                .collect();
            series.push(Series {
                label: curve.label.clone(),
                side: if self.errors.is_empty() { Side::Left } else { Side::Right },
                colour: Colour::Curve(1 + index),
                dash: Dash::Dashed,
                width: 1.8,
                marker: Some(marker),
                points,
            });
        }
        let mut rules = Vec::new();
        if let Some(index) = self.chosen {
            let label = format!("chosen {}", self.values[index]);
            rules.push(Rule { x: positions[index], label, dash: Dash::Dashed });
        }
        if let Some(index) = self.default.filter(|&index| Some(index) != self.chosen) {
            let label = format!("default {}", self.values[index]);
            rules.push(Rule { x: positions[index], label, dash: Dash::Dotted });
        }
        Ok(Figure::new(Chart {
            description: self.description(),
            title,
            x: self.horizontal(&positions),
            // Without scores, ranks are all there is: they get the left axis.
            left: if self.errors.is_empty() { self.ranks() } else { self.scores() },
            right: self.has_two_axes().then(|| self.ranks()),
            series,
            rules,
        }))
    }

    fn title(&self) -> String {
        format!("{}: sensitivity to {}", self.sensor, self.field)
    }

    fn description(&self) -> String {
        let Self { sensor, field, score, .. } = self;
        if self.errors.is_empty() {
            return format!("Worst rank of each {field} in each calibration model, for {sensor}.");
        }
        let right = if self.worst_ranks.is_empty() {
            ""
        } else {
            ", and on the right axis the worst rank in each calibration model; compare shapes and order, not heights"
        };
        format!("Mean {} of {sensor} for each {field}{right}.", score.name)
    }

    fn check(&self, title: &str) -> Result<(), ReportError> {
        let empty = |missing| ReportError::Empty { figure: title.to_owned(), missing };
        if self.values.is_empty() {
            return Err(empty("values"));
        }
        if self.errors.is_empty() && self.worst_ranks.is_empty() {
            return Err(empty("curves"));
        }
        let expected = self.values.len();
        let errors = self.errors.iter().map(|curve| (&curve.label, curve.summaries.len()));
        let ranks = self.worst_ranks.iter().map(|curve| (&curve.label, curve.worst_ranks.len()));
        for (curve, got) in errors.chain(ranks) {
            if got != expected {
                let (figure, curve) = (title.to_owned(), curve.clone());
                return Err(ReportError::Points { figure, curve, expected, got });
            }
        }
        for (what, index) in
            [("the chosen value", self.chosen), ("the default value", self.default)]
        {
            if let Some(index) = index.filter(|&index| index >= expected) {
                let figure = title.to_owned();
                return Err(ReportError::OutOfGrid { figure, what, index, len: expected });
            }
        }
        Ok(())
    }

    /// Horizontal position of each value: the number itself, or its place in the grid if any value is a name.
    fn positions(&self) -> Vec<f64> {
        let numbers: Option<Vec<f64>> = self.values.iter().map(Setting::as_number).collect();
        numbers.unwrap_or_else(|| (0..self.values.len()).map(|place| place as f64).collect())
    }

    fn horizontal(&self, positions: &[f64]) -> Axis {
        let numeric = self.values.iter().all(|value| value.as_number().is_some());
        let scale = if numeric {
            Scale::log_around(positions)
        } else {
            Scale::names(self.values.iter().map(ToString::to_string).collect())
        };
        Axis { label: self.field.clone(), scale }
    }

    fn scores(&self) -> Axis {
        let summaries = || self.errors.iter().flat_map(|curve| curve.summaries.iter().flatten());
        let means: Vec<f64> =
            summaries().map(|summary| summary.mean).filter(|mean| mean.is_finite()).collect();
        let (lowest, highest) = means
            .iter()
            .fold((f64::MAX, f64::MIN), |(low, high), &mean| (low.min(mean), high.max(mean)));
        let spread = highest - lowest;
        // A single wild interval must not press all curves flat: it may reach one spread beyond the means.
        let ends = summaries()
            .filter(|summary| summary.mean.is_finite())
            .filter_map(|summary| summary.interval);
        let ends = ends.flat_map(|interval| {
            [interval.low.max(lowest - spread), interval.high.min(highest + spread)]
        });
        let positive = means.iter().all(|&mean| mean > 0.0);
        let values: Vec<f64> = ends
            .filter(|&end| !positive || end > 0.5 * lowest)
            .chain(means.iter().copied())
            .collect();
        let scale = Scale::around(&values);
        Axis { label: format!("mean {}", self.score.name), scale }
    }

    fn ranks(&self) -> Axis {
        let label = "worst rank (1 = best)".to_owned();
        Axis { label, scale: Scale::ranks(self.values.len()) }
    }

    /// Whether scores and ranks share the figure, on two axes.
    pub(crate) fn has_two_axes(&self) -> bool {
        !self.errors.is_empty() && !self.worst_ranks.is_empty()
    }
}

fn error_points(positions: &[f64], summaries: &[Option<Summary>]) -> Vec<Point> {
    positions
        .iter()
        .zip(summaries)
        .map(|(&x, summary)| Point {
            x,
            y: summary.map_or(f64::NAN, |summary| summary.mean),
            interval: summary
                .and_then(|summary| summary.interval)
                .map(|ends| (ends.low, ends.high)),
        })
        .collect()
}
