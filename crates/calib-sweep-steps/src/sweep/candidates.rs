//! The settings of a study.

use calib_base::{StepError, bail, ensure};
use calib_core::Seed;
use calib_study::Study;
use calib_sweep::{Candidate, candidates};

/// Returns the settings that a study sweeps.
///
/// # Errors
/// Returns an error if its agents act, it names no sensors, or its grid is invalid.
pub fn candidates_of(study: &Study) -> Result<Vec<Candidate>, StepError> {
    require_predicting(study)?;
    if study.sweep.sensors.is_empty() {
        bail!("sweep.sensors is empty; name the sensors to predict, such as [\"PIT300\"]");
    }
    let seed = Seed::new(study.seed).child("sweep");
    Ok(candidates(&study.sweep, &study.agent, seed)?)
}

/// Refuses a study whose agents act, which other commands tune.
///
/// # Errors
/// If the agents of the study act.
pub fn require_predicting(study: &Study) -> Result<(), StepError> {
    ensure!(
        !study.is_of_acting_agents(),
        "the agents of this study act ([control], and no sweep.sensors); `calib control` tunes them, on several machines with --share 0/2 and so on"
    );
    Ok(())
}
