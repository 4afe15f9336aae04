//! The savings and the choice of a race, computed from the results of a complete sweep.

use calib_base::StepError;
use calib_sweep::{EnvironmentId, Judging, SensorVerdict, UnitResult, raced, verdict};
use calib_sweep_steps::verdict::judged::Judged;

/// The outcome of a race among existing runs.
pub(super) struct RaceOutcome {
    /// Position of the setting that the study's rule chooses after the race.
    pub(super) chosen: usize,
    /// Share of the updates in members and on the log that the race would save.
    pub(super) saved: f64,
}

/// Applies a race to the sensor of `whole`, with the same part of each run and the same selection
/// rule.
pub(super) fn outcome(judged: &Judged, whole: &SensorVerdict) -> Result<RaceOutcome, StepError> {
    let Judged { manifest, results, .. } = judged;
    let own = results.iter().filter(|result| result.unit.sensor == whole.sensor).cloned();
    let own: Vec<UnitResult> = own.collect();
    let values = manifest.candidates.len();
    let left = raced(&own, values, whole.part);
    let judging = Judging::of_choice(whole.part, whole.rule, &manifest.scales);
    let chosen = verdict(&whole.sensor, &manifest.candidates, &left, &judging)?.chosen;
    let made = updates(&left);
    let all = updates(&own);
    Ok(RaceOutcome { chosen, saved: if all > 0.0 { 1.0 - made / all } else { 0.0 } })
}

/// Returns the updates of runs that a choice is made from. Online runs only judge it.
fn updates(results: &[UnitResult]) -> f64 {
    let choosing = results.iter().filter(|result| result.unit.environment != EnvironmentId::Online);
    choosing.flat_map(|result| &result.rows).map(|row| row.updates as f64).sum()
}
