//! The seed of a study's agents.

use calib_core::Seed;
use calib_study::Study;

/// Returns the root of the agents' seeds.
pub fn agent_seed(study: &Study) -> Seed {
    Seed::new(study.seed).child("agent")
}
