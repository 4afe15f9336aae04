use calib_core::Seed;
use calib_files::Fingerprint;

use super::SensorGroup;
use crate::{Candidate, Start};

/// The inputs of a unit's runs that are neither part of a setting nor shared by the whole plan.
pub(super) struct UnitInputs<'i> {
    pub(super) group: &'i SensorGroup<'i>,
    /// Predicted state column.
    pub(super) column: usize,
    pub(super) agents: &'i [&'i Candidate],
    /// The checkpoint that the agents start from, if they were pre-trained.
    pub(super) start: Option<&'i Start>,
    pub(super) seed: Seed,
    /// Fingerprint of the stream's inputs.
    pub(super) stream: &'i Fingerprint,
}
