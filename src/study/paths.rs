use std::path::{Path, PathBuf};

/// Where the files of a study lie.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StudyPaths {
    study: PathBuf,
    root: PathBuf,
    model: Option<String>,
}

impl StudyPaths {
    /// The layout below `root` of the results of the file `study`.
    pub fn new(study: PathBuf, root: PathBuf) -> Self {
        Self { study, root, model: None }
    }

    /// The layout of one of several models of the study.
    #[must_use]
    pub(crate) fn of_model(&self, name: &str) -> Self {
        let root = self.root.join("models").join(name);
        Self { study: self.study.clone(), root, model: Some(name.to_owned()) }
    }

    /// The sweeps of the study's other models, as far as there are any.
    pub(crate) fn other_sweeps(&self) -> Vec<PathBuf> {
        let together = self.model.as_ref().and_then(|_| self.root.parent());
        let entries = together.and_then(|of| std::fs::read_dir(of).ok()).into_iter().flatten();
        let roots = entries.flatten().map(|entry| entry.path()).filter(|path| *path != self.root);
        let mut sweeps: Vec<PathBuf> = roots.map(|root| root.join("sweep")).collect();
        sweeps.sort();
        sweeps
    }

    /// The study file.
    pub fn study(&self) -> &Path {
        &self.study
    }

    /// What to type to run `command` on the study.
    pub fn command(&self, command: &str) -> String {
        let model = self.model.as_ref().filter(|_| command != "pretrain");
        let model = model.map_or_else(String::new, |name| format!(" --model {name}"));
        format!("calib {command} {}{model}", self.study.display())
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

    /// Pre-trained agents; the models of a study share them.
    pub fn pretrain(&self) -> PathBuf {
        let of_study = match self.model {
            Some(_) => self.root.ancestors().nth(2).unwrap_or(&self.root),
            None => &self.root,
        };
        of_study.join("pretrain")
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
