//! The calibration model of a study, built.

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use calib_base::outcome::{Freshness, Outcome};

use crate::model::{
    jumps,
    model_files::{ModelFacts, ModelManifest},
    recurrence,
};

/// The calibration model of a study.
#[derive(Debug)]
pub struct BuiltModel {
    /// Its manifest.
    pub manifest: ModelManifest,
    pub(crate) directory: PathBuf,
    pub(crate) freshness: Freshness,
    pub(crate) took: Duration,
    /// The outcome of the comparison with brute force, if it was requested.
    pub(crate) verified: Outcome,
}

impl BuiltModel {
    /// Returns the number of rows of its states.
    pub fn rows(&self) -> usize {
        self.manifest.rows
    }

    /// Returns the number of transitions of each member.
    pub fn transitions(&self) -> Vec<usize> {
        self.manifest.members.iter().map(|member| member.transitions).collect()
    }

    /// Returns whether it existed already.
    pub fn freshness(&self) -> Freshness {
        self.freshness
    }

    /// Returns the directory of the model.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// Returns warnings for users of the model: how far rollouts of its members get.
    pub fn warnings(&self) -> Vec<String> {
        warnings(&self.manifest)
    }
}

/// Returns warnings for users of results of the model: how far rollouts of its members get.
pub fn warnings(manifest: &ModelFacts) -> Vec<String> {
    let ModelFacts { members, study, .. } = manifest;
    let jumps = members.iter().map(|member| (member.jumps.as_ref(), member.transitions));
    let of_rollouts = recurrence::warnings(members, study.model.remove_traps);
    [of_rollouts, jumps::warnings(jumps, &study.model, study.sweep.steps)].concat()
}
