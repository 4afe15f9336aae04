use super::check_finite;
use crate::StatsError;

/// A trajectory has collapsed if the variance at its end is below this share of the data's variance (our choice). The
/// share corresponds to a tenth of the data's standard deviation.
const COLLAPSED: f64 = 0.01;

/// The share at the end of a trajectory whose variance counts (our choice).
const TAIL: f64 = 0.25;

/// Maximum distance of a collapsed trajectory from the mean of its end, in standard deviations of the data (our choice).
const BAND: f64 = 0.2;

/// Minimum number of values in that part. Shorter trajectories are not judged (our choice).
const FEWEST: usize = 20;

/// Returns the step at which a trajectory collapses. `None` if the variance over its last quarter is at least 1 % of
/// `data_variance`, and for trajectories of fewer than 80 values. Otherwise it is the first step from which on all
/// values lie within 0.2 standard deviations of the data of the mean of that quarter.
///
/// Networks that feed on their own predictions tend to run into a fixed point (the paper: after 50 to 100 steps). A
/// trajectory that drifts away or oscillates has not collapsed in this sense. If the data are as constant for so long,
/// recorded trajectories collapse too: compare with them.
///
/// # Errors
/// If a value is not finite, or there are no values.
pub fn collapse_step(values: &[f64], data_variance: f64) -> Result<Option<usize>, StatsError> {
    check_finite("a trajectory", values)?;
    let tail = (values.len() as f64 * TAIL) as usize;
    if tail < FEWEST || data_variance <= 0.0 {
        return Ok(None);
    }
    let end = &values[values.len() - tail..];
    let centre = end.iter().sum::<f64>() / tail as f64;
    let variance = end.iter().map(|value| (value - centre).powi(2)).sum::<f64>() / tail as f64;
    if variance >= COLLAPSED * data_variance {
        return Ok(None);
    }
    let band = BAND * data_variance.sqrt();
    let last_outside = values.iter().rposition(|value| (value - centre).abs() > band);
    Ok(Some(last_outside.map_or(0, |step| step + 1)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(steps: usize) -> Vec<f64> {
        (0..steps).map(|t| (t as f64 * 0.2).sin()).collect()
    }

    #[test]
    fn a_fixed_point_is_a_collapse_where_it_begins() {
        let mut values = wave(100);
        values.extend(vec![0.3; 900]);
        let step = collapse_step(&values, 0.5).expect("finite").expect("it collapses");
        // The last value of the wave is far from the fixed point.
        assert_eq!(step, 100);
        // A slow approach counts from the step at which it is near.
        let decay: Vec<f64> = (0..400).map(|t| 0.5_f64.powf(f64::from(t) / 10.0)).collect();
        assert_eq!(collapse_step(&decay, 1.0).expect("finite"), Some(24));
        assert_eq!(collapse_step(&vec![0.3; 400], 0.5).expect("finite"), Some(0));
    }

    #[test]
    fn what_moves_has_not_collapsed() {
        assert_eq!(collapse_step(&wave(1000), 0.5).expect("finite"), None);
        let drift: Vec<f64> = (0..1000).map(|t| f64::from(t) * 0.01).collect();
        assert_eq!(collapse_step(&drift, 0.5).expect("finite"), None);
        let mut brief = wave(900);
        brief.extend(vec![0.0; 100]);
        assert_eq!(collapse_step(&brief, 0.5).expect("finite"), None, "quiet for too short");
    }

    #[test]
    fn what_cannot_be_judged_is_not() {
        assert_eq!(collapse_step(&vec![0.0; 79], 0.5).expect("finite"), None);
        assert_eq!(collapse_step(&vec![0.0; 400], 0.0).expect("finite"), None, "constant data");
        assert!(collapse_step(&[f64::NAN], 0.5).is_err());
        assert!(collapse_step(&[], 0.5).is_err());
    }
}
