use super::check_finite;
use crate::StatsError;

/// A trajectory has collapsed from where on its variance is below this share of the data's (our choice): a spread of a
/// tenth of the data's.
const COLLAPSED: f64 = 0.01;

/// The part at the end of a trajectory that must be that quiet (our choice).
const TAIL: f64 = 0.25;

/// Fewest values of that part; shorter trajectories are not judged (our choice).
const FEWEST: usize = 20;

/// The step at which a trajectory collapses: the first from which on all values to the end have a variance of less than
/// 1 % of `data_variance`. `None` if the last quarter is not that quiet, and for trajectories of fewer than 80 values.
///
/// Networks that feed on their own predictions tend to run into a fixed point (the paper: after 50 to 100 steps); a
/// trajectory that drifts away or oscillates has not collapsed in this sense. Where the data itself is quiet for so
/// long, recorded trajectories collapse too: compare with them.
///
/// # Errors
/// If a value is not finite, or there is none.
pub fn collapse_step(values: &[f64], data_variance: f64) -> Result<Option<usize>, StatsError> {
    check_finite("a trajectory", values)?;
    let tail = (values.len() as f64 * TAIL) as usize;
    if tail < FEWEST || data_variance <= 0.0 {
        return Ok(None);
    }
    let most = COLLAPSED * data_variance;
    // Mean and sum of squared deviations of ever longer ends (Welford 1962).
    let (mut count, mut mean, mut squares) = (0.0, 0.0, 0.0);
    let mut collapsed = values.len();
    for (step, value) in values.iter().enumerate().rev() {
        count += 1.0;
        let before = value - mean;
        mean += before / count;
        squares += before * (value - mean);
        if squares / count >= most {
            break;
        }
        collapsed = step;
    }
    Ok((values.len() - collapsed >= tail).then_some(collapsed))
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
        // A few of the values before add less than 1 % of the variance to the long quiet end.
        assert!((85..=100).contains(&step), "{step}");
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
