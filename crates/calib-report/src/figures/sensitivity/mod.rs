//! Sensitivity curves: the error, and the worst rank of the models, against a hyperparameter.

mod axes;
mod curves;
mod heat;
mod panels;
mod slices;

use calib_stats::{Direction, Summary};

use crate::chart::{Chart, Dash, Rule};
use crate::{Figure, ReportError, Setting};

pub(crate) use heat::{Heat, HeatCell};

/// Error measure of runs: RMSE relative to the standard deviation of the training returns.
pub(crate) const NRMSE: &str = "NRMSE";

/// Smaller errors are better.
const LOWER: Direction = Direction::LowerIsBetter;

/// Sensitivity curves of one sensor.
///
/// ```
/// use calib_report::{ErrorCurve, ErrorSource, RankCurve, Samples, Sensitivity, Setting};
/// use calib_stats::summarise;
///
/// let online = [[0.31, 0.33], [0.20, 0.22], [0.41, 0.38]];
/// let figure = Sensitivity {
///     sensor: "PIT300".to_owned(),
///     field: "learning_rate".to_owned(),
///     values: [1e-5, 1e-4, 1e-3].map(Setting::from).to_vec(),
///     errors: vec![ErrorCurve {
///         label: "Online".to_owned(),
///         source: ErrorSource::Online,
///         over: Samples::Runs,
///         summaries: online.iter().map(|runs| summarise(runs).ok()).collect(),
///     }],
///     worst_ranks: vec![RankCurve { label: "kNN".to_owned(), worst_ranks: vec![2, 1, 3] }],
///     chosen: Some(1),
///     default: Some(2),
///     dimensions: vec![],
/// };
/// assert!(figure.figure()?.svg().starts_with("<svg"));
/// # Ok::<(), calib_report::ReportError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Sensitivity {
    /// The predicted sensor.
    pub sensor: String,
    /// The swept hyperparameter, as in the study file: "`learning_rate`".
    pub field: String,
    /// The settings in the order of the grid.
    pub values: Vec<Setting>,
    /// Mean errors with intervals, on the left axis.
    pub errors: Vec<ErrorCurve>,
    /// Worst rank of each calibration model, on the right axis.
    pub worst_ranks: Vec<RankCurve>,
    /// Index of the recommended setting.
    pub chosen: Option<usize>,
    /// Index of the default setting.
    pub default: Option<usize>,
    /// The swept hyperparameters, if a setting combines several.
    pub dimensions: Vec<Dimension>,
}

/// One of several hyperparameters that are swept together.
#[derive(Debug, Clone, PartialEq)]
pub struct Dimension {
    /// Its name, as in the study file.
    pub field: String,
    /// Its value in each combination of the grid.
    pub values: Vec<Setting>,
}

/// Error against hyperparameter in one environment.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorCurve {
    /// Name in the legend.
    pub label: String,
    /// Environment of the errors.
    pub source: ErrorSource,
    /// Samples that the mean is over.
    pub over: Samples,
    /// Summary over the samples, one per setting; `None` where nothing was run.
    pub summaries: Vec<Option<Summary>>,
}

/// Environments whose error is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorSource {
    /// Replay of the held-out period, which judges the choice.
    Online,
    /// Replay of the training range: the cheap alternative to a calibration model.
    LogReplay,
    /// A simple predictor on held-out data. No setting changes it, so it is a horizontal line.
    Simple,
    /// A calibration model that is not an ensemble.
    Model,
    /// Evidence of a choice by mean errors: one curve per ensemble, in the order of `worst_ranks`.
    Evidence,
}

/// Samples that a mean error is over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Samples {
    /// Training runs.
    Runs,
    /// Windows, each with the mean of its runs.
    Windows,
    /// Training runs in ensemble members and on the replayed log, as a selection method counts them.
    Streams,
}

impl Samples {
    /// Returns the name of the samples.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Runs => "runs",
            Self::Windows => "windows",
            Self::Streams => "streams",
        }
    }
}

/// Worst rank against hyperparameter in one ensemble.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RankCurve {
    /// Name of the calibration model.
    pub label: String,
    /// Worst ranks, one per setting: 1 = best.
    pub worst_ranks: Vec<usize>,
}

impl Sensitivity {
    /// Draws the figure. The horizontal axis is logarithmic if all values are positive numbers. Mean errors with
    /// 95 % whiskers are on the left, and worst ranks on the right (on the left without errors). Diverged values
    /// are crosses at the upper edge. Lower is better on both axes, so that shapes can be compared.
    ///
    /// Several hyperparameters have one plot each: a [slice](Self::slices) through the choice.
    ///
    /// # Errors
    ///
    /// If the grid is empty, there is no curve, a curve does not have one point per setting, or a marked setting
    /// is not in the grid.
    pub fn figure(&self) -> Result<Figure, ReportError> {
        let title = format!("{}: sensitivity to {}", self.sensor, self.field);
        self.check(&title)?;
        let slices = self.slices();
        if !slices.is_empty() {
            return self.sliced(title, &slices);
        }
        Ok(Figure::new(self.chart(title)))
    }

    /// Returns a chart with all curves in one plot.
    fn chart(&self, title: String) -> Chart {
        let positions = self.positions();
        Chart {
            description: self.description(),
            title,
            x: self.horizontal_axis(&positions),
            // Without errors, the ranks have the left axis.
            left: if self.errors.is_empty() { self.rank_axis() } else { self.error_axis() },
            right: self.has_two_axes().then(|| self.rank_axis()),
            series: self.curves(&positions),
            rules: self.rules(&positions),
        }
    }

    /// Whether errors and ranks share the figure, on two axes.
    pub(crate) fn has_two_axes(&self) -> bool {
        !self.errors.is_empty() && !self.worst_ranks.is_empty()
    }

    fn rules(&self, positions: &[f64]) -> Vec<Rule> {
        let default = self.default.filter(|&index| Some(index) != self.chosen);
        let chosen = self.chosen.map(|index| self.rule("chosen", positions, index, Dash::Dashed));
        chosen
            .into_iter()
            .chain(default.map(|index| self.rule("default", positions, index, Dash::Dotted)))
            .collect()
    }

    /// Returns the rule at setting `index`, with its name and value.
    fn rule(&self, name: &str, positions: &[f64], index: usize, dash: Dash) -> Rule {
        let label = format!("{name} {}", self.values[index]);
        Rule { x: positions[index], label, dash }
    }

    fn check(&self, title: &str) -> Result<(), ReportError> {
        let missing = if self.values.is_empty() {
            Some("values")
        } else if self.errors.is_empty() && self.worst_ranks.is_empty() {
            Some("curves")
        } else {
            None
        };
        if let Some(missing) = missing {
            return Err(ReportError::Empty { figure: title.to_owned(), missing });
        }
        let expected = self.values.len();
        let errors = self.errors.iter().map(|curve| (&curve.label, curve.summaries.len()));
        let ranks = self.worst_ranks.iter().map(|curve| (&curve.label, curve.worst_ranks.len()));
        let dimensions =
            self.dimensions.iter().map(|dimension| (&dimension.field, dimension.values.len()));
        for (curve, got) in errors.chain(ranks).chain(dimensions) {
            if got != expected {
                let figure = title.to_owned();
                let curve = curve.clone();
                return Err(ReportError::Points { figure, curve, expected, got });
            }
        }
        for (what, index) in [("the chosen setting", self.chosen), ("the default", self.default)] {
            if let Some(index) = index.filter(|&index| index >= expected) {
                let figure = title.to_owned();
                return Err(ReportError::OutOfGrid { figure, what, index, len: expected });
            }
        }
        Ok(())
    }
}
