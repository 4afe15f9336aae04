//! A fitted predictor with its cross-validated errors.

use super::FittedPredictor;

/// A predictor that was fitted on all rows, with its cross-validated errors.
pub(super) struct Judged {
    pub(super) predictor: FittedPredictor,
    /// Sum over later folds, each predicted by the fit to earlier folds. Infinite if one of these fits has no solution.
    pub(super) squared_error: f64,
    /// Error in each fold, predicted by the fit to the other folds.
    pub(super) cross_errors: Vec<f64>,
}

impl Judged {
    /// Returns the mean of the errors over folds, or 0 if there are no folds.
    pub(super) fn mean_cross_error(&self) -> f64 {
        self.cross_errors.iter().sum::<f64>() / self.cross_errors.len().max(1) as f64
    }

    /// Returns the geometric mean of the errors over folds, each with `rest` added.
    pub(super) fn typical_cross_error(&self, rest: f64) -> f64 {
        let errors = self.cross_errors.iter().map(|error| (error.max(0.0) + rest).ln());
        (errors.sum::<f64>() / self.cross_errors.len().max(1) as f64).exp()
    }
}
