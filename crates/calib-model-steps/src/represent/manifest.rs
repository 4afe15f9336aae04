//! The manifest of the representations of a study.

use std::path::Path;

use calib_base::artefact::{Artefact, Facts};
use calib_files::Fingerprint;
use calib_study::{StepKind, Study};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{candidate::Candidate, grid};

/// `manifest.json` of a representation directory.
pub type RepresentationManifest = Artefact<RepresentationFacts>;

/// Representations and their scores, in the manifest.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub struct RepresentationFacts {
    /// Fingerprint of the data and the configuration.
    pub(crate) key: String,
    /// The study that they were made with.
    #[schemars(with = "calib_base::resolved::ResolvedStudy")]
    pub study: Study,
    /// Fingerprint of the data that they were trained or imported for.
    pub(crate) data: Fingerprint,
    /// Number of rows that ψ was scored on: the last fifth.
    pub(crate) validation_rows: usize,
    pub(crate) candidates: Vec<Candidate>,
    /// Index of the chosen candidate; none if no candidate qualifies.
    pub(crate) chosen: Option<usize>,
}

impl Facts for RepresentationFacts {
    const FORMAT: u32 = 2;
    const STEP: StepKind = StepKind::Represent;

    fn key(&self) -> &str {
        &self.key
    }

    fn has_all_parts(&self, directory: &Path) -> bool {
        self.candidates.iter().all(|candidate| grid::is_whole(directory, candidate))
    }
}
