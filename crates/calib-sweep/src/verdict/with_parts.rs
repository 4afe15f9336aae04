//! The verdict with the choices by other parts of the runs.

use super::{Grade, Judging, SensorVerdict, judge::SensorResults, parts, warnings};
use crate::{Candidate, SweepError, UnitResult};

/// Judges one sensor from the results of its units.
///
/// # Errors
/// Returns an error if results are missing, cannot be ranked, or have no step to score.
pub fn verdict(
    sensor: &str,
    candidates: &[Candidate],
    results: &[UnitResult],
    judging: &Judging<'_>,
) -> Result<SensorVerdict, SweepError> {
    let own = results.iter().filter(|result| result.unit.sensor == sensor).collect();
    let results = SensorResults { sensor, candidates, own };
    let mut verdict = results.judged(&results.measured(judging)?, judging)?;
    let chosen = verdict.chosen;
    let parts = parts::choices(&results, judging, chosen)?;
    let start_up_share = parts::start_up_share(&results.own, chosen);
    // Without an agent to deploy, it does not matter which part of a run counts.
    if matches!(verdict.grade, Grade::Good | Grade::Fair | Grade::Unchecked)
        && verdict.learning_off.is_none()
    {
        let of_parts = warnings::of_parts(&verdict, candidates, &parts, start_up_share);
        verdict.warnings.extend(of_parts);
    }
    Ok(SensorVerdict { parts, start_up_share, ..verdict })
}
