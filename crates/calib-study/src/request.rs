use std::path::PathBuf;

use crate::Share;

/// A request: a study file and the options given with it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Request {
    /// Path of the study file.
    pub study: PathBuf,
    /// Overrides in the order of their application: `section.key=value`.
    pub set: Vec<String>,
    /// Name of the profile, the `NAME` of `[profiles.NAME]`.
    pub profile: Option<String>,
    /// Name of the model, the `NAME` of `[models.NAME]`; all models if `None`.
    pub model: Option<String>,
    /// Name of the deployment, the `NAME` of `[deployments.NAME]`; all deployments if `None`.
    pub deployment: Option<String>,
    /// Folder of the results; it replaces the one in the study.
    pub output: Option<PathBuf>,
    /// Policy for existing and missing results.
    pub policy: Policy,
}

impl Request {
    /// Creates a request for the whole study in a file, as written.
    pub fn new(study: impl Into<PathBuf>) -> Self {
        Self { study: study.into(), ..Self::default() }
    }
}

/// Policy for results.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Policy {
    /// Treatment of existing results.
    pub existing: Existing,
    /// Treatment of missing results.
    pub writes: Writes,
    /// This process's share of the work, if several processes divide it.
    pub share: Option<Share>,
}

/// Treatment of existing results.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Existing {
    /// Results that are up to date are kept.
    #[default]
    Keep,
    /// All results are computed again.
    Redo,
}

/// Treatment of missing results.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Writes {
    /// Missing results are computed and written.
    #[default]
    Missing,
    /// Nothing is written. calib only reports what it would compute.
    Nothing,
}

impl Policy {
    /// Whether all results are computed again.
    pub fn redoes(self) -> bool {
        self.existing == Existing::Redo
    }

    /// Whether nothing is written.
    pub fn is_dry(self) -> bool {
        self.writes == Writes::Nothing
    }
}
