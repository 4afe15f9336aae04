//! Intervals of estimates that were made again without each part of the data.

use crate::Interval;
use crate::summary::around;

/// 95 % interval of an estimate `whole` from what it is `without` each of B parts of the data, `[B]`:
/// whole ± t₀.₉₇₅(B − 1) · √((B − 1)/B · Σ(x − x̄)²).
///
/// Parts are what is independent: blocks of a log, plants. Estimates that each lack one part share all others and differ
/// little, however few independent parts there are; their differences are B − 1 times as small as those of the parts.
/// Of a mean over equally large parts it is Student's t-interval over them. What varies beside the parts, such as the
/// seeds of runs, counts (B − 1)² times, so that the interval is then too wide rather than too narrow. `None` for fewer
/// than two parts, and where a number is not finite. Source: Tukey (1958); Efron & Stein (1981) show that its variance
/// is rather too large than too small.
pub fn jackknife(whole: f64, without: &[f64]) -> Option<Interval> {
    let error = jackknife_error(without).filter(|_| whole.is_finite())?;
    around(whole, error, without.len() as f64 - 1.0)
}

/// The standard error √((B − 1)/B · Σ(x − x̄)²) of the same; `None` likewise.
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
