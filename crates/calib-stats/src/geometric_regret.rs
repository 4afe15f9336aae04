//! What a choice costs over several windows.

use serde::{Deserialize, Serialize};

use crate::StatsError;
use crate::error::check;

/// Regret over windows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GeometricRegret {
    /// By what factor errors exceed the best ones, minus 1; +∞ where the choice diverged in a window (`null` in files).
    #[serde(with = "crate::diverged")]
    pub regret: f64,
    /// Windows that count.
    pub windows: usize,
    /// Windows that do not, because every candidate diverged in them.
    pub left_out: usize,
}

/// Regret of choosing candidate `choice(w)` in each window w of `errors` `[window][candidate]`.
///
/// exp(mean over windows of (ln error of the choice − ln smallest error)) − 1: each window has a best candidate of its
/// own, and a window counts by its quotient, not by the size of its errors. 0: the choice is best in every window;
/// 0.05: its errors are typically 5 % larger than the best. The quotient of two errors of 0 is 1; that of a positive
/// error and 0 is infinite. `None` where every window is left out. Source: the geometric mean is that of quotients
/// (Fleming & Wallace 1986); its use for regret over windows is our choice.
///
/// # Errors
///
/// There are no windows, one has no candidates, windows differ in their number of candidates, an error is NaN or
/// negative, or a choice is out of range.
pub fn geometric_regret<Row: AsRef<[f64]>>(
    errors: &[Row],
    choice: impl Fn(usize) -> usize,
) -> Result<Option<GeometricRegret>, StatsError> {
    const WHAT: &str = "errors of a window";
    let first = errors.first().ok_or(StatsError::Empty { what: "the windows" })?;
    let expected = first.as_ref().len();
    let (mut sum, mut windows) = (0.0, 0);
    for (row, own) in errors.iter().map(AsRef::as_ref).enumerate() {
        let index = choice(row);
        check(WHAT, own)?;
        if own.len() != expected {
            return Err(StatsError::Ragged { what: WHAT, row, expected, got: own.len() });
        }
        if let Some(index) = own.iter().position(|&error| error < 0.0) {
            return Err(StatsError::Negative { what: WHAT, index });
        }
        let error =
            *own.get(index).ok_or(StatsError::OutOfRange { what: WHAT, index, len: own.len() })?;
        let best = own.iter().copied().fold(f64::INFINITY, f64::min);
        if best.is_finite() {
            sum += if error == best { 0.0 } else { error.ln() - best.ln() };
            windows += 1;
        }
    }
    let left_out = errors.len() - windows;
    let regret = (windows > 0).then(|| (sum / windows as f64).exp_m1());
    Ok(regret.map(|regret| GeometricRegret { regret, windows, left_out }))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{Direction, regret};

    const INF: f64 = f64::INFINITY;

    fn of(errors: &[&[f64]], choice: usize) -> Option<GeometricRegret> {
        geometric_regret(errors, |_| choice).unwrap()
    }

    #[test]
    fn quotients_are_averaged_geometrically() {
        // Twice the best in one window and best in the other: a factor of sqrt 2.
        let told = of(&[&[0.2, 0.1], &[3.0, 9.0]], 0).unwrap();
        assert!((told.regret - (2_f64.sqrt() - 1.0)).abs() < 1e-12);
        assert_eq!((told.windows, told.left_out), (2, 0));
        let chooser = geometric_regret(&[[0.2, 0.1], [3.0, 9.0]], |window| 1 - window).unwrap();
        assert_eq!(chooser.unwrap().regret, 0.0, "another choice in each window");
    }

    #[test]
    fn divergence_of_the_choice_is_infinite_and_of_all_is_left_out() {
        assert_eq!(of(&[&[INF, 0.1], &[0.1, 0.2]], 0).unwrap().regret, INF);
        let told = of(&[&[INF, INF], &[0.1, 0.2]], 0).unwrap();
        assert_eq!((told.regret, told.windows, told.left_out), (0.0, 1, 1));
        assert_eq!(of(&[&[INF, INF]], 0), None);
    }

    #[test]
    fn errors_of_zero_are_the_best_there_are() {
        assert_eq!(of(&[&[0.0, 0.0]], 1).unwrap().regret, 0.0);
        assert_eq!(of(&[&[0.0, 0.1], &[1.0, 1.0]], 1).unwrap().regret, INF);
    }

    #[test]
    fn bad_input_is_an_error() {
        let none: [[f64; 2]; 0] = [];
        assert!(matches!(geometric_regret(&none, |_| 0), Err(StatsError::Empty { .. })));
        let ragged = geometric_regret(&[vec![1.0], vec![1.0, 2.0]], |_| 0);
        assert!(matches!(ragged, Err(StatsError::Ragged { row: 1, expected: 1, got: 2, .. })));
        let range = geometric_regret(&[[1.0, 2.0]], |_| 2);
        assert!(matches!(range, Err(StatsError::OutOfRange { index: 2, len: 2, .. })));
        let negative = geometric_regret(&[[1.0, -2.0]], |_| 0);
        assert!(matches!(negative, Err(StatsError::Negative { index: 1, .. })));
        assert!(geometric_regret(&[[1.0, f64::NAN]], |_| 0).is_err());
    }

    proptest! {
        #[test]
        fn one_window_has_the_usual_regret(errors in prop::collection::vec(0.01f64..9.0, 1..8)) {
            for choice in 0..errors.len() {
                let usual = regret(&errors, choice, Direction::LowerIsBetter).unwrap().unwrap();
                let told = of(&[&errors], choice).unwrap().regret;
                prop_assert!((told - usual).abs() < 1e-9 * (1.0 + usual));
            }
        }

        /// What a window's errors are measured in does not matter.
        #[test]
        fn the_scale_of_a_window_does_not_matter(
            table in prop::collection::vec((prop::collection::vec(0.01f64..9.0, 4), 0.01f64..100.0), 1..6),
            choice in 0usize..4
        ) {
            let plain: Vec<Vec<f64>> = table.iter().map(|of| of.0.clone()).collect();
            let scaled: Vec<Vec<f64>> =
                table.iter().map(|(row, by)| row.iter().map(|error| error * by).collect()).collect();
            let told = |rows: &[Vec<f64>]| geometric_regret(rows, |_| choice).unwrap().unwrap().regret;
            prop_assert!((told(&plain) - told(&scaled)).abs() < 1e-9 * (1.0 + told(&plain)));
            prop_assert!(told(&plain) >= 0.0);
        }
    }
}
