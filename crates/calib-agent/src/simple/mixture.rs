//! A mixture of all simple predictors, weighted by their past accuracy.

use calib_core::Stream;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::FittedPredictor;

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
    pub(super) fn predictions(&self, stream: &dyn Stream) -> Vec<f32> {
        let mut each: Vec<Vec<f32>> =
            self.predictors.iter().map(|predictor| predictor.predictions(stream)).collect();
        let mut mixed = vec![0.0; stream.len()];
        let delay = (JUDGED_AFTER / (1.0 - self.gamma)).ceil().max(1.0) as usize;
        let powers: Vec<f64> = (0..=delay).map(|k| self.gamma.powi(k as i32)).collect();
        let prior = PRIOR_STRETCHES * delay as f64;
        let mut sums: Vec<f64> = self.errors.iter().map(|error| prior * error).collect();
        let mut count = prior;
        for piece in stream.pieces() {
            let value_at = |t: usize| f64::from(stream.state(t)[self.column]);
            for t in piece.clone() {
                let value = value_at(t);
                if t >= piece.start + delay {
                    let seen = (t - delay + 1..=t).zip(&powers);
                    let seen: f64 = seen.map(|(row, power)| power * value_at(row)).sum();
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
