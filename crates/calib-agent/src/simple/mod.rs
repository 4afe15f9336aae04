//! Simple predictors of a sensor's return: fitted once on recorded data, without a step size to tune.
//!
//! They are what an agent has to beat before it is worth deploying, and what it can start from.

mod autoregression;
mod fit;
mod fitted;
mod judged;
mod moments;
mod solve;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use fit::Fitter;
pub use fitted::{FittedPredictor, Mixture};

/// A predictor of the return `G_t = Σ_k γᵏ o_{t+k+1}` of a sensor `o`. It learns nothing after the log ends.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum SimplePredictor {
    /// The mean return of the training range.
    Mean,
    /// The sensor keeps its value: `o_t / (1 − γ)`. Nothing is fitted.
    Persistence,
    /// A line on the sensor, `a + b o_t`, by least squares.
    Line,
    /// Least squares on the latest values of the sensor. Cross-validation chooses how many.
    Autoregression,
    /// Ridge regression on all columns of the state, with the penalty that cross-validation chooses. The intercept and the predicted
    /// sensor itself are not penalised, so that a large penalty gives a line.
    Ridge,
    /// Least-squares TD on all columns of the state (Bradtke and Barto 1996): the linear predictor that TD(0) converges to. It is
    /// penalised, and the penalty chosen, as in ridge regression.
    #[serde(rename = "least_squares_td")]
    LeastSquaresTd,
    /// The best of these predictors by cross-validation: each is fitted on four fifths of the log and judged on the other fifth. The
    /// criterion is the geometric mean of the errors. Of two predictors within 1 % of each other, the simpler one.
    Best,
    /// All of these predictors, weighted by how well each has predicted so far.
    Mixture,
}

impl SimplePredictor {
    /// All that predict in a way of their own, the simplest first.
    pub const ALL: [Self; 6] = [
        Self::Mean,
        Self::Persistence,
        Self::Line,
        Self::Autoregression,
        Self::Ridge,
        Self::LeastSquaresTd,
    ];

    /// Whether it reads no other column than that of the predicted sensor.
    pub const fn reads_the_sensor_alone(self) -> bool {
        matches!(self, Self::Mean | Self::Persistence | Self::Line | Self::Autoregression)
    }

    /// Returns the name in a study and in JSON.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Mean => "mean",
            Self::Persistence => "persistence",
            Self::Line => "line",
            Self::Autoregression => "autoregression",
            Self::Ridge => "ridge",
            Self::LeastSquaresTd => "least_squares_td",
            Self::Best => "best",
            Self::Mixture => "mixture",
        }
    }

    /// Returns the name in text.
    pub const fn label(self) -> &'static str {
        match self {
            Self::Mean => "the training mean",
            Self::Persistence => "persistence",
            Self::Line => "a line on the sensor",
            Self::Autoregression => "an autoregression",
            Self::Ridge => "ridge regression",
            Self::LeastSquaresTd => "least-squares TD",
            Self::Best => "the best simple predictor",
            Self::Mixture => "a mixture of simple predictors",
        }
    }
}

#[cfg(test)]
mod tests;
