//! Delete-one-block jackknife intervals.

use crate::Interval;
use crate::summary::around;

/// Returns the 95 % interval of an estimate `whole` from the estimates `without` each of B parts of the data, `[B]`:
/// whole ± t₀.₉₇₅(B − 1) · √((B − 1)/B · Σ(x − x̄)²).
///
/// Parts must be independent: blocks of a log, or plants. Estimates that each lack one part share all other parts and
/// differ little, even if there are few independent parts: their differences are B − 1 times smaller than those of the
/// parts. For a mean over equally large parts, the result is Student's t-interval over them. Other sources of variance,
/// such as the seeds of runs, count (B − 1)² times, so that the interval is then too wide rather than too narrow.
/// `None` for fewer than two parts, and where a number is not finite. Source: Tukey (1958); Efron & Stein (1981) show
/// that its variance tends to be too large rather than too small.
pub fn jackknife(whole: f64, without: &[f64]) -> Option<Interval> {
    let error = jackknife_error(without).filter(|_| whole.is_finite())?;
    around(whole, error, without.len() as f64 - 1.0)
}

/// Returns the standard error √((B − 1)/B · Σ(x − x̄)²) of the same estimate, or `None` as in [`jackknife`].
pub fn jackknife_error(without: &[f64]) -> Option<f64> {
    let parts = without.len() as f64;
    if without.len() < 2 || !without.iter().all(|value| value.is_finite()) {
        return None;
    }
    let mean = without.iter().sum::<f64>() / parts;
    let squares: f64 = without.iter().map(|value| (value - mean).powi(2)).sum();
    Some(((parts - 1.0) / parts * squares).sqrt())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::summarise;

    #[test]
    fn what_cannot_be_told_has_no_interval() {
        assert_eq!(jackknife(1.0, &[1.0]), None);
        assert_eq!(jackknife(1.0, &[1.0, f64::INFINITY]), None);
        assert_eq!(jackknife(f64::NEG_INFINITY, &[1.0, 2.0]), None);
        assert_eq!(jackknife(1.0, &[1.0, 1.0]), Some(Interval { low: 1.0, high: 1.0 }));
    }

    proptest! {
        #[test]
        fn of_a_mean_it_is_students_t(parts in prop::collection::vec(-9.0f64..9.0, 2..20)) {
            let summary = summarise(&parts).unwrap();
            let sum: f64 = parts.iter().sum();
            let others = parts.len() as f64 - 1.0;
            let without: Vec<f64> = parts.iter().map(|part| (sum - part) / others).collect();
            let own = jackknife(summary.mean, &without).unwrap();
            let plain = summary.interval.unwrap();
            prop_assert!((own.low - plain.low).abs() < 1e-9 && (own.high - plain.high).abs() < 1e-9);
        }
    }
}
