//! Mean, spread and interval over runs.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::StatsError;
use crate::error::check;

/// A closed interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Interval {
    /// Lower end.
    #[serde(with = "crate::diverged")]
    #[schemars(with = "crate::diverged::Stored")]
    pub low: f64,
    /// Upper end; infinite if divergence is among the likely outcomes (`null` in files for +∞).
    #[serde(with = "crate::diverged")]
    #[schemars(with = "crate::diverged::Stored")]
    pub high: f64,
}

/// The mean of a sample of runs, with its spread.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Summary {
    /// Number of runs.
    pub runs: usize,
    /// Number of runs that are infinite, that is, diverged.
    pub diverged: usize,
    /// Arithmetic mean; infinite if any run is (`null` in files for +∞).
    #[serde(with = "crate::diverged")]
    #[schemars(with = "crate::diverged::Stored")]
    pub mean: f64,
    /// Sample standard deviation (divisor n − 1); `None` for one run or an infinite mean.
    pub std: Option<f64>,
    /// 95 % t-interval of the mean; `None` for one run or an infinite mean.
    pub interval: Option<Interval>,
}

impl Summary {
    /// The summary of no runs, with an infinite mean.
    pub const NONE: Self =
        Self { runs: 0, diverged: 0, mean: f64::INFINITY, std: None, interval: None };
}

/// Summarises `runs` `[runs]`: one number for each run, never for each time step.
///
/// mean = Σx / n, std = √(Σ(x − mean)² / (n − 1)), interval = mean ± t · std / √n, where t is the 0.975 quantile of
/// Student's t distribution with n − 1 degrees of freedom. Source: the paper shows 95 % confidence intervals over runs;
/// the t-interval is our choice.
///
/// # Errors
///
/// `runs` is empty, holds NaN, or holds infinities of both signs.
pub fn summarise(runs: &[f64]) -> Result<Summary, StatsError> {
    let mean = mean(runs)?;
    let diverged = runs.iter().filter(|value| value.is_infinite()).count();
    let std = sample_std(runs)?;
    let interval = std.and_then(|std| t_interval(mean, std, runs.len()));
    Ok(Summary { runs: runs.len(), diverged, mean, std, interval })
}

/// Summarises `windows` `[n]` of one series, of which only `independent` would fit side by side into the covered range.
///
/// The mean counts every window equally. If n overlapping windows cover as much as I windows side by side, its variance
/// is that of I means of rows. The interval is mean ± t₀.₉₇₅(I − 1) · c · std / √I, with c² = (1 − 1/n) / (1 − 1/I)
/// because windows that share rows differ less than others. Without overlap it is that of [`summarise`]. There is no
/// interval for one independent window. Derived for windows whose errors are means over rows; docs/metrics.md has its
/// coverage.
///
/// # Errors
///
/// As [`summarise`].
pub fn summarise_overlapping(windows: &[f64], independent: usize) -> Result<Summary, StatsError> {
    let summary = summarise(windows)?;
    let n = windows.len();
    if independent >= n {
        return Ok(summary);
    }
    let freedom = independent.saturating_sub(1) as f64;
    let all = n as f64;
    let interval = summary.std.filter(|_| freedom > 0.0).and_then(|std| {
        let factor = ((1.0 - 1.0 / all) / freedom).sqrt();
        around(summary.mean, factor * std, freedom)
    });
    Ok(Summary { interval, ..summary })
}

/// Returns the arithmetic mean of `values` `[n]`; infinite if any value is.
///
/// # Errors
///
/// `values` is empty, holds NaN, or holds infinities of both signs.
pub fn mean(values: &[f64]) -> Result<f64, StatsError> {
    check("values", values)?;
    let sum: f64 = values.iter().sum();
    if sum.is_nan() {
        return Err(StatsError::OpposedInfinities { what: "values" });
    }
    Ok(sum / values.len() as f64)
}

/// Returns the sample standard deviation of `values` `[n]`, divisor n − 1. `None` for n = 1 and where a value is
/// infinite.
///
/// # Errors
///
/// `values` is empty, holds NaN, or holds infinities of both signs.
pub fn sample_std(values: &[f64]) -> Result<Option<f64>, StatsError> {
    let mean = mean(values)?;
    if values.len() < 2 || mean.is_infinite() {
        return Ok(None);
    }
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    Ok(Some((squares / (values.len() - 1) as f64).sqrt()))
}

/// Returns the t-interval of the mean of `n` values.
pub(crate) fn t_interval(mean: f64, std: f64, n: usize) -> Option<Interval> {
    around(mean, std / (n as f64).sqrt(), (n - 1) as f64)
}

/// Returns the interval `centre` ± t₀.₉₇₅(`freedom`) · `standard_error`.
pub(crate) fn around(centre: f64, standard_error: f64, freedom: f64) -> Option<Interval> {
    let t = StudentsT::new(0.0, 1.0, freedom).ok()?.inverse_cdf(0.975);
    let half_width = t * standard_error;
    Some(Interval { low: centre - half_width, high: centre + half_width })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_run_has_a_mean_but_no_spread() {
        let summary = summarise(&[0.25]).unwrap();
        assert_eq!((summary.mean, summary.std, summary.interval), (0.25, None, None));
    }

    #[test]
    fn equal_runs_have_an_interval_of_no_width() {
        let interval = summarise(&[0.5; 4]).unwrap().interval.unwrap();
        assert_eq!((interval.low, interval.high), (0.5, 0.5));
    }

    #[test]
    fn windows_that_overlap_count_as_often_as_they_fit() {
        let windows = [1.0, 3.0, 2.0, 4.0, 5.0];
        assert_eq!(summarise_overlapping(&windows, 5), summarise(&windows));
        assert_eq!(summarise_overlapping(&windows, 1).unwrap().interval, None);
        // s² = 5/2 and I = 3: (4/5) · (5/2) / 2 = 1, t(2) = 4.302652730.
        let summary = summarise_overlapping(&windows, 3).unwrap();
        assert_eq!((summary.mean, summary.runs), (3.0, 5));
        assert!((summary.interval.unwrap().high - 7.302_652_73).abs() < 1e-7);
    }

    #[test]
    fn one_diverged_run_makes_the_mean_infinite() {
        let summary = summarise(&[0.1, f64::INFINITY, 0.2, f64::INFINITY]).unwrap();
        assert_eq!(summary.mean, f64::INFINITY);
        assert_eq!((summary.diverged, summary.std, summary.interval), (2, None, None));
    }

    #[test]
    fn what_has_no_mean_is_an_error() {
        assert_eq!(mean(&[]), Err(StatsError::Empty { what: "values" }));
        assert_eq!(
            mean(&[1.0, f64::NAN]),
            Err(StatsError::NotANumber { what: "values", index: 1 })
        );
        assert_eq!(
            summarise(&[f64::INFINITY, f64::NEG_INFINITY]),
            Err(StatsError::OpposedInfinities { what: "values" })
        );
    }
}
