//! Losses of candidates over several windows.

use crate::error::check;
use crate::summary::{sample_std, t_interval};
use crate::{Bounded, Estimate, Interval, StatsError, upper_bound};

/// Losses: logarithms of errors relative to the smallest error of their window. 0 is the best of a window, ln 2 twice
/// its error.
///
/// Each window has its own best candidate and counts by ratios, not by the size of its errors. Windows in which every
/// candidate diverged have no best candidate and are excluded.
#[derive(Debug, Clone, PartialEq)]
pub struct Losses {
    /// Losses `[window][candidate]`; +∞ where a candidate diverged.
    windows: Vec<Vec<f64>>,
    left_out: usize,
}

impl Losses {
    /// Computes the losses of `errors` `[window][candidate]`. The ratio of two errors of 0 is 1; that of a positive
    /// error and 0 is infinite. Without windows there are no losses.
    ///
    /// # Errors
    ///
    /// A window has no candidates, windows differ in their number of candidates, or an error is NaN or negative.
    pub fn new<Row: AsRef<[f64]>>(errors: &[Row]) -> Result<Self, StatsError> {
        const WHAT: &str = "errors of a window";
        let expected = errors.first().map_or(0, |first| first.as_ref().len());
        let mut windows = Vec::new();
        for (row, own) in errors.iter().map(AsRef::as_ref).enumerate() {
            check(WHAT, own)?;
            if own.len() != expected {
                return Err(StatsError::Ragged { what: WHAT, row, expected, got: own.len() });
            }
            if let Some(index) = own.iter().position(|&error| error < 0.0) {
                return Err(StatsError::Negative { what: WHAT, index });
            }
            let best = own.iter().copied().fold(f64::INFINITY, f64::min);
            if best.is_finite() {
                windows.push(
                    own.iter()
                        .map(|&error| if error == best { 0.0 } else { error.ln() - best.ln() })
                        .collect(),
                );
            }
        }
        let left_out = errors.len() - windows.len();
        Ok(Self { windows, left_out })
    }

    /// Returns the number of windows that count.
    pub const fn windows(&self) -> usize {
        self.windows.len()
    }

    /// Returns the number of excluded windows, in which every candidate diverged.
    pub const fn left_out(&self) -> usize {
        self.left_out
    }

    /// Returns the mean loss of each candidate over windows, or `None` if no window counts.
    pub fn means(&self) -> Option<Vec<f64>> {
        let candidates = self.windows.first()?.len();
        Some((0..candidates).map(|candidate| mean(&self.of_candidate(candidate))).collect())
    }

    /// Returns the regret of a candidate, exp(mean over windows of its losses) − 1, with an upper bound over windows,
    /// or `None` if no window counts.
    ///
    /// 0 means that it is best in every window; 0.05 that its errors are typically 5 % larger than the best. The best
    /// of a window is the smallest of means over few runs, so the noise of runs can make a regret larger, but not
    /// smaller. The bound is exp([`upper_bound`] of the losses) − 1. There is no bound for fewer than four windows,
    /// where the losses of all windows are equal or all but one are 0, and where one is infinite. Source: the geometric
    /// mean is that of ratios (Fleming & Wallace 1986); its use for regret over windows is our choice.
    pub fn regret(&self, candidate: usize) -> Option<Bounded> {
        let losses = self.of_candidate(candidate);
        let upper = upper_bound(&losses).ok()?;
        Some(Bounded { value: mean(&losses).exp_m1(), upper: upper.map(f64::exp_m1) })
    }

    /// Returns the geometric mean over windows of the error of `candidate` relative to that of `other`. `None` if no
    /// window counts, or both diverged in one window.
    ///
    /// The interval is exp(mean ± t₀.₉₇₅(W − 1) · s / √W), with the standard deviation s of the differences of the
    /// losses over the W windows. There is no interval for one window, whose runs do not tell how another window
    /// differs, nor where a difference is infinite. The interval uses t rather than percentiles of resampled windows,
    /// which are too narrow for few windows (Hesterberg 2015, section 5): with two windows and two runs, a difference
    /// of zero was found "surely" worse in 23 % of cases instead of 2.5 %.
    pub fn quotient(&self, candidate: usize, other: usize) -> Option<Estimate> {
        let differences: Vec<f64> =
            self.windows.iter().map(|losses| losses[candidate] - losses[other]).collect();
        let opposed =
            differences.contains(&f64::INFINITY) && differences.contains(&f64::NEG_INFINITY);
        if opposed || differences.iter().any(|difference| difference.is_nan()) {
            return None;
        }
        let (mean, interval) = mean_with_interval(&differences)?;
        Some(Estimate {
            value: mean.exp(),
            interval: interval
                .map(|interval| Interval { low: interval.low.exp(), high: interval.high.exp() }),
        })
    }

    /// Returns the regret of a selection method that sees one of these windows and is judged on another. It is exp(mean
    /// of the losses of the best candidate of one window in another) − 1, over the ordered pairs of windows in which
    /// that candidate did not diverge. `None` if there is no such pair.
    ///
    /// One window with one or two runs is weak evidence. Selection methods that see more of the plant, as calib does in
    /// a log, can do better.
    pub fn another_window(&self) -> Option<f64> {
        let mut others = Vec::new();
        for (window, own) in self.windows.iter().enumerate() {
            let chosen = (0..own.len()).min_by(|&a, &b| own[a].total_cmp(&own[b]))?;
            let rest = self.windows.iter().enumerate().filter(|&(other, _)| other != window);
            others.extend(rest.map(|(_, losses)| losses[chosen]).filter(|loss| loss.is_finite()));
        }
        (!others.is_empty()).then(|| mean(&others).exp_m1())
    }

    fn of_candidate(&self, candidate: usize) -> Vec<f64> {
        self.windows.iter().map(|losses| losses[candidate]).collect()
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Returns the mean and t-interval of values, some of which may be infinite. `None` without values.
fn mean_with_interval(values: &[f64]) -> Option<(f64, Option<Interval>)> {
    let std = sample_std(values).ok()?;
    Some((mean(values), std.and_then(|std| t_interval(mean(values), std, values.len()))))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const INF: f64 = f64::INFINITY;

    fn regret(errors: &[&[f64]], candidate: usize) -> Option<f64> {
        Losses::new(errors).unwrap().regret(candidate).map(|regret| regret.value)
    }

    #[test]
    fn quotients_are_averaged_geometrically() {
        // Twice the best error in one window and best in the other: a factor of sqrt 2.
        let losses = Losses::new(&[[0.2, 0.1], [3.0, 9.0]]).unwrap();
        assert!((losses.regret(0).unwrap().value - (2_f64.sqrt() - 1.0)).abs() < 1e-12);
        assert_eq!((losses.windows(), losses.left_out()), (2, 0));
        // 2 and 1/3: a factor of sqrt(2/3).
        let quotient = losses.quotient(0, 1).unwrap();
        assert!((quotient.value - (2.0_f64 / 3.0).sqrt()).abs() < 1e-12);
        // The best of the first window is candidate 1, with three times the best error in the second. The other way
        // round the factor is 2.
        assert!((losses.another_window().unwrap() - (6_f64.sqrt() - 1.0)).abs() < 1e-12);
    }

    #[test]
    fn intervals_of_quotients_are_those_of_students_t_over_windows() {
        // Differences ln 2, 0, 0 of losses: mean 0.2310, standard deviation 0.4002, t(2) = 4.3027.
        let losses = Losses::new(&[[0.2, 0.1], [1.0, 1.0], [1.0, 1.0]]).unwrap();
        let interval = losses.quotient(0, 1).unwrap().interval.unwrap();
        let half = 4.302_652_73 * (2_f64.ln() / 3_f64.sqrt()) / 3_f64.sqrt();
        assert!((interval.high - (2_f64.ln() / 3.0 + half).exp()).abs() < 1e-6, "{interval:?}");
        let one = Losses::new(&[[0.2, 0.1]]).unwrap();
        assert_eq!((one.quotient(0, 1).unwrap().interval, one.another_window()), (None, None));
    }

    /// Returns the bound of the regret of the first candidate.
    fn upper(errors: &[[f64; 2]]) -> Option<f64> {
        Losses::new(errors).unwrap().regret(0).unwrap().upper
    }

    #[test]
    fn a_regret_is_bounded_where_windows_differ() {
        let best = [0.1, 0.2];
        assert_eq!(upper(&[best; 8]), None, "best in every window is no certainty");
        assert_eq!(upper(&[[0.2, 0.1], best, best]), None, "three windows");
        let bound = upper(&[[0.2, 0.1], best, [0.3, 0.2], best]).unwrap();
        let of_losses = upper_bound(&[2_f64.ln(), 0.0, 1.5_f64.ln(), 0.0]).unwrap().unwrap();
        assert!((bound / of_losses.exp_m1() - 1.0).abs() < 1e-9);
        assert_eq!(upper(&[[INF, 0.1], best, best, best]), None);
    }

    #[test]
    fn divergence_is_infinite_and_of_all_is_left_out() {
        assert_eq!(regret(&[&[INF, 0.1], &[0.1, 0.2]], 0), Some(INF));
        let losses = Losses::new(&[[INF, INF], [0.1, 0.2]]).unwrap();
        assert_eq!((losses.windows(), losses.left_out()), (1, 1));
        assert_eq!(losses.regret(0).unwrap().value, 0.0);
        assert_eq!(regret(&[&[INF, INF]], 0), None);
        assert_eq!(Losses::new(&[[INF, INF]]).unwrap().means(), None);
        let none: [[f64; 2]; 0] = [];
        assert_eq!(Losses::new(&none).unwrap().means(), None);
        // One of the two ordered pairs is left out: the best candidate of one window diverged in the other.
        let losses = Losses::new(&[[0.1, 0.2], [INF, 0.2]]).unwrap();
        assert!((losses.another_window().unwrap() - 1.0).abs() < 1e-12);
        let both = Losses::new(&[[0.1, INF], [INF, 0.2]]).unwrap();
        assert_eq!(both.another_window(), None, "nothing to compare with");
        assert_eq!(both.quotient(0, 1), None);
        let worse = Losses::new(&[[INF, 0.1], [0.2, 0.2]]).unwrap().quotient(0, 1).unwrap();
        assert_eq!((worse.value, worse.interval), (INF, None));
    }

    #[test]
    fn errors_of_zero_are_the_best_there_are() {
        assert_eq!(regret(&[&[0.0, 0.0]], 1), Some(0.0));
        assert_eq!(regret(&[&[0.0, 0.1], &[1.0, 1.0]], 1), Some(INF));
    }

    #[test]
    fn bad_input_is_an_error() {
        let ragged = Losses::new(&[vec![1.0], vec![1.0, 2.0]]);
        assert!(matches!(ragged, Err(StatsError::Ragged { row: 1, expected: 1, got: 2, .. })));
        let negative = Losses::new(&[[1.0, -2.0]]);
        assert!(matches!(negative, Err(StatsError::Negative { index: 1, .. })));
        assert!(Losses::new(&[[1.0, f64::NAN]]).is_err());
    }

    proptest! {
        #[test]
        fn one_window_has_the_plain_regret(errors in prop::collection::vec(0.01f64..9.0, 1..8)) {
            let best = errors.iter().copied().fold(INF, f64::min);
            for candidate in 0..errors.len() {
                let plain = errors[candidate] / best - 1.0;
                let told = regret(&[&errors], candidate).unwrap();
                prop_assert!((told - plain).abs() < 1e-9 * (1.0 + plain));
            }
        }

        /// The unit of a window's errors does not matter.
        #[test]
        fn the_scale_of_a_window_does_not_matter(
            table in prop::collection::vec((prop::collection::vec(0.01f64..9.0, 4), 0.01f64..100.0), 1..6),
            candidate in 0usize..4
        ) {
            let plain: Vec<Vec<f64>> = table.iter().map(|row| row.0.clone()).collect();
            let scaled: Vec<Vec<f64>> =
                table.iter().map(|(row, by)| row.iter().map(|error| error * by).collect()).collect();
            let told = |rows: &[Vec<f64>]| Losses::new(rows).unwrap().regret(candidate).unwrap().value;
            prop_assert!((told(&plain) - told(&scaled)).abs() < 1e-9 * (1.0 + told(&plain)));
            prop_assert!(told(&plain) >= 0.0);
        }
    }
}
