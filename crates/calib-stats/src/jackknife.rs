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

/// The least share of the jackknife's variance that [`jackknife_of_kinds`] leaves. A difference of two estimated variances may come out
/// near 0. With this share, intervals of five parts and three kinds contain the truth in at least 92.5 % of cases whatever the noise (with a
/// quarter in 89 %), if a part changes all kinds alike. If it changes each kind by itself and there is no noise, it is 88 %, and 85 % with
/// ten parts. Our choice.
const LEAST_SHARE: f64 = 0.5;

/// Returns the interval of an estimate `whole` as [`jackknife`] does, without the noise of seeds. `without` has K estimates without each of
/// B parts, `[kinds][parts]`, by K kinds of models. The estimate of a part is their mean x.
///
/// The noise of x has the variance s²/K, where s² is the mean square of kind × part with (K − 1)(B − 1) degrees of freedom. The jackknife
/// counts it (B − 1)²/B times, and its true share is 1/B. So the variance is J − (B − 2) s²/K, with J of the jackknife, and at least J/2.
/// What a part changes in one kind alone counts as noise. For one kind it is the jackknife.
pub fn jackknife_of_kinds(whole: f64, without: &[Vec<f64>]) -> Option<Interval> {
    let of_parts = column_means(without);
    let parts = of_parts.len() as f64;
    let error = jackknife_error(&of_parts).filter(|_| whole.is_finite())?;
    let mut variance = error.powi(2);
    if without.len() > 1 {
        let noise = interaction(without, &of_parts) / without.len() as f64;
        variance = (variance - (parts - 2.0) * noise).max(LEAST_SHARE * variance);
    }
    around(whole, variance.sqrt(), parts - 1.0)
}

/// Returns the mean of each column of `rows`, `[rows][columns]`. Without rows there is none.
pub fn column_means<R: AsRef<[f64]>>(rows: &[R]) -> Vec<f64> {
    let columns = rows.first().map_or(0, |row| row.as_ref().len());
    (0..columns)
        .map(|column| rows.iter().map(|row| row.as_ref()[column]).sum::<f64>() / rows.len() as f64)
        .collect()
}

/// Returns the mean square of kind × part of `[kinds][parts]`, whose means over kinds are `of_parts`, `[parts]`.
fn interaction(of_kinds: &[Vec<f64>], of_parts: &[f64]) -> f64 {
    let parts = of_parts.len() as f64;
    let mean = of_parts.iter().sum::<f64>() / parts;
    let mut squares = 0.0;
    for kind in of_kinds {
        let own = kind.iter().sum::<f64>() / parts;
        for (value, of_part) in kind.iter().zip(of_parts) {
            squares += (value - own - of_part + mean).powi(2);
        }
    }
    squares / ((of_kinds.len() as f64 - 1.0) * (parts - 1.0))
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

    #[test]
    fn the_noise_of_seeds_is_left_out_if_kinds_show_it() {
        // J is 3/4 · 5 = 3.75. The residuals of kind × part are ±0.5: s² is 8 · 0.25 / 3 = 2/3, of which (4 − 2)/2 is taken away. t(3) is 3.182446305.
        let kinds = [vec![0.5, 0.5, 2.5, 2.5], vec![-0.5, 1.5, 1.5, 3.5]];
        let interval = jackknife_of_kinds(1.5, &kinds).unwrap();
        let width = 3.182_446_305 * (3.75f64 - 2.0 / 3.0).sqrt();
        assert!((interval.high - 1.5 - width).abs() < 1e-6, "{interval:?}");
        // Noise alone: half of the variance is left.
        let noise =
            [vec![1.0, -1.0, 0.0, 0.5], vec![-1.0, 1.0, 0.0, 0.5], vec![0.0, 0.0, 3.0, -2.0]];
        let of_parts = [0.0, 0.0, 1.0, -1.0 / 3.0];
        let own = jackknife_of_kinds(0.0, &noise).unwrap();
        let plain = jackknife(0.0, &of_parts).unwrap();
        assert!((2.0f64.sqrt() * own.high - plain.high).abs() < 1e-9, "{own:?} {plain:?}");
        assert_eq!(jackknife_of_kinds(0.0, &[]), None);
        assert_eq!(jackknife_of_kinds(0.0, &[vec![f64::NEG_INFINITY, 1.0], vec![0.0, 1.0]]), None);
    }

    #[test]
    fn means_are_of_columns() {
        assert_eq!(column_means(&[[1.0, 2.0], [3.0, 6.0]]), [2.0, 4.0]);
        assert_eq!(column_means::<[f64; 2]>(&[]), [0.0; 0]);
    }

    proptest! {
        #[test]
        fn of_one_kind_it_is_the_jackknife(parts in prop::collection::vec(-9.0f64..9.0, 2..9)) {
            prop_assert_eq!(jackknife_of_kinds(1.0, std::slice::from_ref(&parts)), jackknife(1.0, &parts));
        }

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
