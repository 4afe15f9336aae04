//! The rollouts of several deployments, taken together.

use super::{
    Comparison,
    pair::Pair,
    summary::{Counts, summary},
};
use crate::StepError;

/// As if all rollouts had been compared at once; nothing where there are none.
pub(crate) fn pool(
    all: &[(&Comparison, &[Pair])],
) -> Result<Option<(Comparison, Vec<Pair>)>, StepError> {
    let Some((first, _)) = all.iter().find(|(of, _)| !of.sensors.is_empty()) else {
        return Ok(None);
    };
    let sum = |of: fn(&Comparison) -> usize| all.iter().map(|(comparison, _)| of(comparison)).sum();
    let counts = Counts {
        rollouts: sum(|of| of.rollouts),
        left_out: sum(|of| of.left_out),
        ended_early: sum(|of| of.ended_early),
    };
    let pairs: Vec<Pair> = all.iter().flat_map(|(_, pairs)| pairs.iter().cloned()).collect();
    let whole = summary(&pairs, counts, first.against)?;
    // Rows of each deployment are counted from its own begin.
    let overlapping = sum(|of| of.overlapping);
    Ok(Some((Comparison { overlapping, ..whole }, pairs)))
}
