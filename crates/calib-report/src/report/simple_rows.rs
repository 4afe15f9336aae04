//! What is known of simple predictors beside the chosen agent.

use calib_agent::SimplePredictor;
use calib_stats::Estimate;

/// Result of a simple predictor on the held-out windows, or on those of the replayed log.
#[derive(Debug, Clone, PartialEq)]
pub struct SimpleRow {
    /// The predictor.
    pub predictor: SimplePredictor,
    /// Mean score over held-out windows, or geometric mean over windows of the log.
    pub error: f64,
    /// Typical error in the sensor's own unit, (1 − γ) RMSE: mean over windows; `None` if the unit is not known.
    pub typical_error: Option<f64>,
    /// Error of the chosen agent divided by that of the predictor: geometric mean over these windows, with its interval.
    pub ratio: Option<Estimate>,
}

/// Comparison of a simple predictor with the chosen agent.
#[derive(Debug, Clone, PartialEq)]
pub struct Simpler {
    /// The predictor.
    pub predictor: SimplePredictor,
    /// Error of the agent divided by that of the predictor: geometric mean over held-out windows, or windows of the log.
    pub ratio: Option<Estimate>,
    /// Whether the predictor is better, and the difference is not chance.
    pub is_better: bool,
    /// Typical errors of predictor and agent, in the sensor's own unit: (1 − γ) RMSE, mean over windows.
    pub typical_errors: Option<[f64; 2]>,
    /// Number of these windows in which the agent has more than ten times the error of the predictor.
    pub runaway_windows: usize,
    /// Whether the agent starts from a simple predictor.
    pub has_baseline: bool,
    /// The predictor that the agent starts from, if cross-validation chose it and it is another one.
    pub starts_from: Option<SimplePredictor>,
}
