//! Mean, spread and interval over runs.

use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::StatsError;
use crate::error::check;

/// A closed interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// What a sample of runs says about its mean.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Number of runs.
    pub runs: usize,
    /// How many of them are infinite, that is, diverged.
    pub diverged: usize,
    /// Arithmetic mean; infinite if any run is (`null` in files for +∞).
    #[serde(with = "crate::diverged")]
    pub mean: f64,
    /// Sample standard deviation (divisor n − 1); `None` for one run or an infinite mean.
    pub std: Option<f64>,
    /// 95 % t-interval of the mean; `None` for one run or an infinite mean.
    pub interval: Option<Interval>,
}

/// Summarises `runs` `[runs]`: one number for each run, never for each time step.
///
/// mean = Σx / n, std = √(Σ(x − mean)² / (n − 1)), interval = mean ± t · std / √n,
/// where t is the 0.975 quantile of Student's t distribution with n − 1 degrees of freedom.
/// Source: the paper shows 95 % confidence intervals over runs; the t-interval is our choice.
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

/// The summary of all runs of several samples, from theirs: the same numbers as those of [`summarise`] over all runs at
/// once, but for rounding. `None` for no sample.
///
/// mean = Σ nᵢ mᵢ / n, (n − 1) std² = Σ ((nᵢ − 1) stdᵢ² + nᵢ (mᵢ − mean)²).
pub fn pooled(samples: &[Summary]) -> Option<Summary> {
    let runs: usize = samples.iter().map(|of| of.runs).sum();
    let diverged = samples.iter().map(|of| of.diverged).sum();
    if runs == 0 {
        return None;
    }
    let mean = samples.iter().map(|of| of.runs as f64 * of.mean).sum::<f64>() / runs as f64;
    let std = (runs > 1 && mean.is_finite()).then(|| {
        let squares = samples.iter().map(|of| {
            let inside = of.runs.saturating_sub(1) as f64 * of.std.unwrap_or(0.0).powi(2);
            inside + of.runs as f64 * (of.mean - mean).powi(2)
        });
        (squares.sum::<f64>() / (runs - 1) as f64).sqrt()
    });
    let interval = std.and_then(|std| t_interval(mean, std, runs));
    Some(Summary { runs, diverged, mean, std, interval })
}

/// Arithmetic mean of `values` `[n]`; infinite if any of them is.
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

/// Sample standard deviation of `values` `[n]`, divisor n − 1. `None` for n = 1 and where a value is infinite.
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

/// The t-interval of the mean of `n` values.
pub(crate) fn t_interval(mean: f64, std: f64, n: usize) -> Option<Interval> {
    around(mean, std / (n as f64).sqrt(), (n - 1) as f64)
}

/// `centre` ± t₀.₉₇₅(`freedom`) · `standard_error`.
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
    fn one_diverged_run_makes_the_mean_infinite() {
        let summary = summarise(&[0.1, f64::INFINITY, 0.2, f64::INFINITY]).unwrap();
        assert_eq!(summary.mean, f64::INFINITY);
        assert_eq!((summary.diverged, summary.std, summary.interval), (2, None, None));
    }

    #[test]
    fn samples_together_are_one_sample() {
        let runs = [0.3, 0.5, 0.1, 0.9, 0.2, 0.7];
        let parts = [&runs[..1], &runs[1..4], &runs[4..]].map(|part| summarise(part).unwrap());
        let (all, one) = (pooled(&parts).unwrap(), summarise(&runs).unwrap());
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        assert_eq!((all.runs, all.diverged), (6, 0));
        near(all.mean, one.mean);
        near(all.std.unwrap(), one.std.unwrap());
        near(all.interval.unwrap().low, one.interval.unwrap().low);
        assert_eq!(pooled(&[]), None);
        let diverged = pooled(&[parts[1], summarise(&[f64::INFINITY]).unwrap()]).unwrap();
        assert_eq!((diverged.mean, diverged.std, diverged.diverged), (f64::INFINITY, None, 1));
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
