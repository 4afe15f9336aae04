//! What a race would have saved, and chosen: read off the results of a whole sweep.

use calib_base::StepError;
use calib_core::Seed;
use calib_sweep::{EnvironmentId, Judging, SensorVerdict, UnitResult, raced, verdict};
use calib_sweep_steps::verdict::evaluate::Judged;

/// A race on the runs that were made.
pub(super) struct RaceOutcome {
    /// Position of the value that the study's rule chooses from what the race leaves.
    pub(super) chosen: usize,
    /// Share of the updates in members and on the log that it would not have made.
    pub(super) saved: f64,
}

/// Of the sensor of `whole`, by the same part of each run and the same rule of choosing.
pub(super) fn outcome(judged: &Judged, whole: &SensorVerdict) -> Result<RaceOutcome, StepError> {
    let Judged { job, manifest, results, .. } = judged;
    let study = job.study();
    let own = results.iter().filter(|result| result.unit.sensor == whole.sensor).cloned();
    let own: Vec<UnitResult> = own.collect();
    let values = manifest.candidates.len();
    let left = raced(&own, values, whole.part);
    let top_k = study.evaluate.top_k;
    let seed = Seed::new(study.seed);
    let judging = Judging::of_choice(whole.part, whole.rule, top_k, &manifest.scales, seed);
    let chosen = verdict(&whole.sensor, &manifest.candidates, &left, &judging)?.chosen;
    let made = updates(&left);
    let all = updates(&own);
    Ok(RaceOutcome { chosen, saved: if all > 0.0 { 1.0 - made / all } else { 0.0 } })
}

/// Updates of runs that a choice is made from: those Online judge it.
fn updates(results: &[UnitResult]) -> f64 {
    let choosing = results.iter().filter(|result| result.unit.environment != EnvironmentId::Online);
    choosing.flat_map(|result| &result.rows).map(|row| row.updates as f64).sum()
}
