use std::path::{Path, PathBuf};

/// Where the files of a study lie.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StudyPaths {
    study: PathBuf,
    root: PathBuf,
}

impl StudyPaths {
    /// The layout below `root` of the results of the file `study`.
    pub fn new(study: PathBuf, root: PathBuf) -> Self {
        Self { study, root }
    }

    /// The study file.
    pub fn study(&self) -> &Path {
        &self.study
    }

    /// What to type to run `command` on the study.
    pub fn command(&self, command: &str) -> String {
        format!("calib {command} {}", self.study.display())
    }

    /// The directory of all results.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Representations of the states.
    pub fn representation(&self) -> PathBuf {
        self.root.join("representation")
    }

    /// The calibration model.
    pub fn model(&self) -> PathBuf {
        self.root.join("model")
    }

    /// Rollouts of the model.
    pub fn rollout(&self) -> PathBuf {
        self.root.join("rollout")
    }

    /// Runs of the sweep.
    pub fn sweep(&self) -> PathBuf {
        self.root.join("sweep")
    }

    /// Verdict and figures.
    pub fn evaluate(&self) -> PathBuf {
        self.root.join("evaluate")
    }

    /// The report.
    pub fn report(&self) -> PathBuf {
        self.root.join("report.html")
    }
}
