//! Sensitivity curves: how the error, and the models' worst rank, depend on a hyperparameter.

mod axes;
mod curves;
mod heat;
mod panels;
mod slices;

use calib_stats::{Direction, Summary};

use crate::chart::{Chart, Dash, Rule};
use crate::{Figure, ReportError, Setting};

pub(crate) use heat::{Heat, HeatCell};

/// What runs are judged by: RMSE relative to the standard deviation of the training returns.
pub(crate) const NRMSE: &str = "NRMSE";

/// Smaller errors are better.
const LOWER: Direction = Direction::LowerIsBetter;

/// One sensitivity figure, for one sensor.
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
    /// The grid, in its order.
    pub values: Vec<Setting>,
    /// Mean error and interval, read on the left axis.
    pub errors: Vec<ErrorCurve>,
    /// Worst rank of each calibration model, read on the right axis.
    pub worst_ranks: Vec<RankCurve>,
    /// Index of the value that is recommended.
    pub chosen: Option<usize>,
    /// Index of the value one would use without calib.
    pub default: Option<usize>,
    /// The swept hyperparameters, where a value of the grid is a combination of several.
    pub dimensions: Vec<Dimension>,
}

/// One of several hyperparameters that are swept together.
#[derive(Debug, Clone, PartialEq)]
pub struct Dimension {
    /// Its name, as in the study file.
    pub field: String,
    /// What it is in each combination of the grid.
    pub values: Vec<Setting>,
}

/// Error against hyperparameter in one environment.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorCurve {
    /// Name in the legend.
    pub label: String,
    /// Which environment it comes from.
    pub source: ErrorSource,
    /// What it is a mean over.
    pub over: Samples,
    /// Summary over these, one for each value of the grid; `None` where nothing was run.
    pub summaries: Vec<Option<Summary>>,
}

/// Environments whose error is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorSource {
    /// Held-out data, replayed: the truth the choice is judged by.
    Online,
    /// Training data, replayed: the cheap alternative to a calibration model.
    LogReplay,
    /// A simple predictor on held-out data, which no value changes: a horizontal line.
    Simple,
    /// A calibration model that is no ensemble.
    Model,
    /// What a choice by mean errors was made from: one curve an ensemble, in the order of `worst_ranks`.
    Evidence,
}

/// What a mean error is over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Samples {
    /// Runs.
    Runs,
    /// Windows, each the mean of its runs.
    Windows,
    /// Streams of members and of the replayed log, as a choice counts them.
    Streams,
}

impl Samples {
    /// What they are called.
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
    /// W, one for each value of the grid: 1 = best.
    pub worst_ranks: Vec<usize>,
}

impl Sensitivity {
    /// Draws the figure: a logarithmic horizontal axis where all values are positive numbers, mean error with
    /// 95 % whiskers on the left, worst rank on the right (on the left if there are no errors).
    /// Diverged values are crosses at the upper edge. Better is down on both axes, so that shapes can be compared.
    ///
    /// Of several hyperparameters there is a plot each: a [slice](Self::slices) through the choice.
    ///
    /// # Errors
    ///
    /// The grid is empty, there is no curve, a curve does not have one point for each value,
    /// or a marked value is not in the grid.
    pub fn figure(&self) -> Result<Figure, ReportError> {
        let title = format!("{}: sensitivity to {}", self.sensor, self.field);
        self.check(&title)?;
        let slices = self.slices();
        if !slices.is_empty() {
            return self.sliced(title, &slices);
        }
        Ok(Figure::new(self.chart(title)))
    }

    /// All curves in one plot.
    fn chart(&self, title: String) -> Chart {
        let positions = self.positions();
        Chart {
            description: self.description(),
            title,
            x: self.horizontal_axis(&positions),
            // Without errors, ranks are all there is: they get the left axis.
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
        let rule = |name: &str, index: usize, dash| {
            let label = format!("{name} {}", self.values[index]);
            Rule { x: positions[index], label, dash }
        };
        let default = self.default.filter(|&index| Some(index) != self.chosen);
        let chosen = self.chosen.map(|index| rule("chosen", index, Dash::Dashed));
        chosen
            .into_iter()
            .chain(default.map(|index| rule("default", index, Dash::Dotted)))
            .collect()
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
