use std::path::PathBuf;

use crate::Share;

/// What is asked for: a study file, and what is given beside it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Request {
    /// The file.
    pub study: PathBuf,
    /// What is laid over it, in order: `section.key=value`.
    pub set: Vec<String>,
    /// The `NAME` of `[profiles.NAME]`.
    pub profile: Option<String>,
    /// The `NAME` of `[models.NAME]`; without it all of them.
    pub model: Option<String>,
    /// The `NAME` of `[deployments.NAME]`; without it all of them.
    pub deployment: Option<String>,
    /// Where results go, whatever the study says.
    pub output: Option<PathBuf>,
    /// What may be done.
    pub policy: Policy,
}

impl Request {
    /// The whole study of a file, as it is written.
    pub fn new(study: impl Into<PathBuf>) -> Self {
        Self { study: study.into(), ..Self::default() }
    }
}

/// What may be done about results.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Policy {
    /// About those that are there.
    pub existing: Existing,
    /// About those that are missing.
    pub writes: Writes,
    /// What of them is made here, where others make the rest.
    pub share: Option<Share>,
}

/// What is done about results that are there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Existing {
    /// What is up to date stays.
    #[default]
    Keep,
    /// Everything is made again.
    Redo,
}

/// Whether anything is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Writes {
    /// What is missing is made.
    #[default]
    Missing,
    /// It is said what would be made.
    Nothing,
}

impl Policy {
    /// Whether everything is made again.
    pub fn redoes(self) -> bool {
        self.existing == Existing::Redo
    }

    /// Whether nothing is written.
    pub fn is_dry(self) -> bool {
        self.writes == Writes::Nothing
    }
}
