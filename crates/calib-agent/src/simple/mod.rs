//! Simple predictors of a sensor's return: fitted once on recorded data, without a step size to tune.
//!
//! They are what an agent has to beat before it is worth deploying, and what it can start from.

mod autoregression;
mod fit;
mod mixture;
mod moments;
mod solve;

use calib_core::Stream;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use fit::Fitter;
pub use mixture::Mixture;

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

/// A simple predictor with the coefficients fitted on a log. Inputs are normalised states, outputs normalised returns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", tag = "form")]
pub enum FittedPredictor {
    /// `bias + Σ_c weights[c] s_t[c]`.
    Affine {
        /// One weight for each column of the state.
        weights: Vec<f64>,
        /// The prediction if all columns are 0.
        bias: f64,
    },
    /// `bias + Σ_k lags[k] o_{t−k}`. Before the first state of a segment the sensor counts as having had its first value.
    Autoregression {
        /// Index of the predicted column.
        column: usize,
        /// The coefficient of the current value, then of the values before it.
        lags: Vec<f64>,
        /// The constant term.
        bias: f64,
    },
    /// A weighted mean of other predictors.
    Mixture(Mixture),
}

impl FittedPredictor {
    /// Returns the prediction at every state of `stream`, from that state and those before it in its piece.
    ///
    /// # Panics
    /// If the states are narrower than those that the predictor was fitted on.
    pub fn predictions(&self, stream: &dyn Stream) -> Vec<f32> {
        if let Self::Mixture(mixture) = self {
            return mixture.predictions(stream);
        }
        let mut predictions = vec![0.0; stream.len()];
        for piece in stream.pieces() {
            for t in piece.clone() {
                let value = match self {
                    Self::Affine { weights, bias } => {
                        let state = &stream.state(t)[..weights.len()];
                        bias + weights
                            .iter()
                            .zip(state)
                            .map(|(w, &x)| w * f64::from(x))
                            .sum::<f64>()
                    }
                    Self::Autoregression { column, lags, bias } => {
                        let values = (0..lags.len()).map(|lag| {
                            let earlier = t.saturating_sub(lag).max(piece.start);
                            f64::from(stream.state(earlier)[*column])
                        });
                        bias + lags.iter().zip(values).map(|(w, x)| w * x).sum::<f64>()
                    }
                    Self::Mixture(_) => unreachable!("predicts by itself"),
                };
                predictions[t] = value as f32;
            }
        }
        predictions
    }
}

#[cfg(test)]
mod tests;
