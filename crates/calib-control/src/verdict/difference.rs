//! Means and differences of returns over ensemble members.

use calib_stats::{Difference, StatsError, jackknife, paired_difference};

pub(super) fn mean(returns: &[f64]) -> f64 {
    returns.iter().sum::<f64>() / returns.len() as f64
}

/// Returns the mean of `own` minus `other`, `[members]` each; `None` if both diverged in a member, so that there is no difference.
///
/// Each ensemble member lacks one block of the log and shares all others, so the interval is the jackknife's over blocks. An
/// interval that treated members as independent would contain another log's difference the less often, the more runs there are.
pub(super) fn beyond(own: &[f64], other: &[f64]) -> Result<Option<Difference>, StatsError> {
    let members: Vec<usize> = (0..own.len()).collect();
    let difference = match paired_difference(&members, own, other) {
        Ok(difference) => difference,
        Err(StatsError::OpposedInfinities { .. }) => return Ok(None),
        Err(error) => return Err(error),
    };
    let each: Vec<f64> = own.iter().zip(other).map(|(own, other)| own - other).collect();
    Ok(Some(Difference { interval: jackknife(difference.mean, &each), ..difference }))
}
