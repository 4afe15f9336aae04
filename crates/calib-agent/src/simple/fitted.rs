//! Predictors fitted on a log, and the mixture of all of them, weighted by their past accuracy.

use calib_core::Stream;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

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

/// Steps after which a prediction is scored, in units of 1 / (1 − γ). Later rewards contribute a twentieth of the
/// return.
const JUDGED_AFTER: f64 = 3.0;

/// The errors in the log count as much as those over this many independently scored stretches.
const PRIOR_STRETCHES: f64 = 3.0;

/// A mean of simple predictors, weighted by how well each predicts.
///
/// A prediction is judged n = 3 / (1 − γ) steps later, by the return observed by then, with the latest value in place of
/// the rest. Each predictor i has a mean squared error `e_i`, which starts at its error on later folds of the log. Its
/// weight is proportional to `e_i^(−m/2)`. This is its likelihood if errors are normal with an unknown variance and m of
/// them are independent, one in n steps (Bayesian model averaging; the tail and the count of errors are our choice). So the
/// weight of a predictor falls fast where its errors are large, and slowly where predictors are nearly equal.
///
/// A return is a weighted mean of future values. So predictions are clipped to the range of the log and of the current
/// value. This keeps a linear predictor from predicting values far outside of everything recorded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Mixture {
    /// Index of the predicted column.
    pub column: usize,
    /// Smallest and largest value of the column in the log.
    pub range: [f64; 2],
    /// Discount factor γ.
    pub gamma: f64,
    /// The predictors of the mixture.
    pub predictors: Vec<FittedPredictor>,
    /// Mean squared error of each predictor on later folds of the log.
    pub errors: Vec<f64>,
}

impl Mixture {
    /// Returns the prediction at every state of `stream`. The weights of the predictors are kept over gaps.
    fn predictions(&self, stream: &dyn Stream) -> Vec<f32> {
        let mut each: Vec<Vec<f32>> =
            self.predictors.iter().map(|predictor| predictor.predictions(stream)).collect();
        let mut mixed = vec![0.0; stream.len()];
        let delay = (JUDGED_AFTER / (1.0 - self.gamma)).ceil().max(1.0) as usize;
        let powers: Vec<f64> = (0..=delay).map(|k| self.gamma.powi(k as i32)).collect();
        let prior = PRIOR_STRETCHES * delay as f64;
        let mut sums: Vec<f64> = self.errors.iter().map(|error| prior * error).collect();
        let mut count = prior;
        for piece in stream.pieces() {
            for t in piece.clone() {
                let value = f64::from(stream.state(t)[self.column]);
                if t >= piece.start + delay {
                    let seen = (t - delay + 1..=t).zip(&powers);
                    let seen: f64 = seen
                        .map(|(row, power)| power * f64::from(stream.state(row)[self.column]))
                        .sum();
                    let result = seen + powers[delay] * value / (1.0 - self.gamma);
                    for (sum, predictions) in sums.iter_mut().zip(&each) {
                        *sum += (f64::from(predictions[t - delay]) - result).powi(2);
                    }
                    count += 1.0;
                }
                let [low, high] = self.range;
                let [low, high] =
                    [low.min(value), high.max(value)].map(|value| value / (1.0 - self.gamma));
                let power = count / delay as f64 / 2.0;
                let least = sums.iter().copied().fold(f64::INFINITY, f64::min);
                let mut total = 0.0;
                let mut weighted = 0.0;
                for (sum, predictions) in sums.iter().zip(&mut each) {
                    let weight = if *sum <= least { 1.0 } else { (least / sum).powf(power) };
                    let cut = f64::from(predictions[t]).clamp(low, high);
                    predictions[t] = cut as f32;
                    total += weight;
                    weighted += weight * cut;
                }
                mixed[t] = (weighted / total) as f32;
            }
        }
        mixed
    }
}
