//! Means and differences of returns over ensemble members.

use calib_stats::{Difference, StatsError, column_means, jackknife_of_kinds, paired_difference};

pub(super) fn mean(returns: &[f64]) -> f64 {
    returns.iter().sum::<f64>() / returns.len() as f64
}

/// Returns the mean of `own` minus `other`, `[kinds][members]` each; `None` if both diverged in the members that lack the same block, so
/// that there is no difference.
///
/// Each ensemble member lacks one block of the log and shares all others, so the interval is the jackknife's over blocks, without the noise
/// of training runs that kinds of models show ([`jackknife_of_kinds`]). An interval that treated members as independent would contain
/// another log's difference the less often, the more runs there are.
pub(super) fn beyond(
    own: &[Vec<f64>],
    other: &[Vec<f64>],
) -> Result<Option<Difference>, StatsError> {
    let [own_means, other_means] = [own, other].map(column_means);
    let blocks: Vec<usize> = (0..own_means.len()).collect();
    let difference = match paired_difference(&blocks, &own_means, &other_means) {
        Ok(difference) => difference,
        Err(StatsError::OpposedInfinities { .. }) => return Ok(None),
        Err(error) => return Err(error),
    };
    let mut each = Vec::new();
    for (own, other) in own.iter().zip(other) {
        each.push(own.iter().zip(other).map(|(own, other)| own - other).collect::<Vec<f64>>());
    }
    Ok(Some(Difference { interval: jackknife_of_kinds(difference.mean, &each), ..difference }))
}
