//! Errors of one-step predictions.

/// Squared errors of predictions of the next state, column by column, beside those of persistence (no change).
///
/// RMSE = √(Σ (ŝ'ₜ − s'ₜ)² / transitions), for one column, or with the mean over all columns as well. *No change*, the
/// persistence forecast, is the same with ŝ' = s. Source: usual; forecasts are usually compared with no change.
#[derive(Debug, Clone, PartialEq)]
pub struct StepErrors {
    predictions: usize,
    squares: Vec<f64>,
    squares_of_no_change: Vec<f64>,
}

impl StepErrors {
    /// Returns an accumulator without predictions, for states of `columns` values.
    pub fn new(columns: usize) -> Self {
        let zeros = vec![0.0; columns];
        Self { predictions: 0, squares: zeros.clone(), squares_of_no_change: zeros }
    }

    /// Adds a prediction of the successor of the state `from`, which was `to`, all `[columns]`.
    ///
    /// # Panics
    /// If one of them has another length.
    pub fn add(&mut self, predicted: &[f64], from: &[f32], to: &[f32]) {
        let columns = self.squares.len();
        assert!([predicted.len(), from.len(), to.len()] == [columns; 3], "states of {columns}");
        self.predictions += 1;
        for column in 0..columns {
            let to = f64::from(to[column]);
            self.squares[column] += (predicted[column] - to).powi(2);
            self.squares_of_no_change[column] += (f64::from(from[column]) - to).powi(2);
        }
    }

    /// Returns the number of predictions.
    pub const fn predictions(&self) -> usize {
        self.predictions
    }

    /// Returns the RMSE of `column`, and that of no change; NaN without predictions.
    ///
    /// # Panics
    /// If there is no such column.
    pub fn of_column(&self, column: usize) -> (f64, f64) {
        let n = self.predictions as f64;
        let [own, of_no_change] =
            [&self.squares, &self.squares_of_no_change].map(|squares| (squares[column] / n).sqrt());
        (own, of_no_change)
    }

    /// Returns the RMSE over all columns, and that of no change; NaN without predictions.
    pub fn of_all(&self) -> (f64, f64) {
        let n = (self.predictions * self.squares.len()) as f64;
        let [own, of_no_change] = [&self.squares, &self.squares_of_no_change]
            .map(|squares| (squares.iter().sum::<f64>() / n).sqrt());
        (own, of_no_change)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_by_hand() {
        let mut errors = StepErrors::new(2);
        errors.add(&[1.5, 0.0], &[1.0, 0.0], &[2.0, 0.0]); // off by 0.5; no change by 1
        errors.add(&[2.5, 4.0], &[2.0, 1.0], &[2.0, 2.0]); // off by 0.5 and 2; no change by 0 and 1
        assert_eq!(errors.predictions(), 2);
        assert_eq!(errors.of_column(0), (0.5, 0.5_f64.sqrt()));
        assert_eq!(errors.of_column(1), (2.0_f64.sqrt(), 0.5_f64.sqrt()));
        assert_eq!(errors.of_all(), ((4.5 / 4.0_f64).sqrt(), 0.5_f64.sqrt()));
    }

    #[test]
    fn a_prediction_out_of_the_numbers_makes_the_error_infinite() {
        let mut errors = StepErrors::new(1);
        errors.add(&[f64::INFINITY], &[0.0], &[1.0]);
        assert_eq!(errors.of_all(), (f64::INFINITY, 1.0));
        assert!(StepErrors::new(1).of_column(0).0.is_nan());
    }
}
