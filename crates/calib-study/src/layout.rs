use std::path::{Path, PathBuf};

use crate::{Scope, StepKind};

/// Paths of the results of a study.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    study: PathBuf,
    /// Folder of the results of the study, or of one of its models.
    root: PathBuf,
    model: Option<String>,
    deployment: Option<(String, Rollouts)>,
}

/// Owner of the rollouts that a deployment uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rollouts {
    /// The deployment has its own rollouts, because their start states follow from it.
    OfDeployment,
    /// All deployments share the rollouts of the model.
    OfModel,
}

impl Layout {
    /// Creates the layout of the results of the study file `study` in the folder `root`.
    pub fn new(study: PathBuf, root: PathBuf) -> Self {
        Self { study, root, model: None, deployment: None }
    }

    /// Returns the layout of one of the study's models.
    #[must_use]
    pub fn of_model(self, name: &str) -> Self {
        let root = self.root.join("models").join(name);
        Self { root, model: Some(name.to_owned()), ..self }
    }

    /// Returns the layout of one deployment of the study, or of one of its models.
    #[must_use]
    pub fn of_deployment(self, name: &str, rollouts: Rollouts) -> Self {
        Self { deployment: Some((name.to_owned(), rollouts)), ..self }
    }

    /// Returns the result folders of a step for the other models of the study, one per model.
    pub fn of_other_models(&self, step: StepKind) -> Vec<PathBuf> {
        let roots = folders(&self.of_study().join("models")).into_iter();
        let roots = roots.filter(|root| *root != self.root);
        let mut all: Vec<PathBuf> =
            roots.map(|root| root.join(step.folder().unwrap_or_default())).collect();
        all.sort();
        all
    }

    /// Returns the existing sweep folders of the study's other models and deployments.
    pub fn other_sweeps(&self) -> Vec<PathBuf> {
        let study = self.of_study();
        let roots: Vec<PathBuf> =
            [study.to_owned()].into_iter().chain(folders(&study.join("models"))).collect();
        let mut sweeps: Vec<PathBuf> = roots
            .into_iter()
            .flat_map(|root| folders(&root.join("deployments")).into_iter().chain([root]))
            .map(|root| root.join(StepKind::Sweep.folder().unwrap_or_default()))
            .filter(|sweep| *sweep != self.sweep() && sweep.is_dir())
            .collect();
        sweeps.sort();
        sweeps
    }

    /// The owner of the deployment's rollouts; `None` if no deployment is chosen.
    pub(crate) fn rollouts(&self) -> Option<Rollouts> {
        self.deployment.as_ref().map(|(_, rollouts)| *rollouts)
    }

    /// The folder of all results of the study, with all its models and deployments.
    pub fn of_study(&self) -> &Path {
        match self.model {
            Some(_) => self.root.ancestors().nth(2).unwrap_or(&self.root),
            None => &self.root,
        }
    }

    /// Returns the folder of the results that depend on the deployment.
    fn of_deployed(&self) -> PathBuf {
        match &self.deployment {
            Some((name, _)) => self.root.join("deployments").join(name),
            None => self.root.clone(),
        }
    }

    /// Path of the study file.
    pub fn study(&self) -> &Path {
        &self.study
    }

    /// The folder of the results of the study, or of one of its models.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Returns the result folder of a step. For `Simulate` it is the folder of
    /// all results: the study gives the log's path.
    pub fn directory(&self, step: StepKind) -> PathBuf {
        let shares_rollouts = matches!(self.deployment, Some((_, Rollouts::OfModel)));
        let parent = match step.scope() {
            // Acting agents do not use the compared models, and a study of acting agents has none.
            Scope::Study if step == StepKind::Control => self.root.clone(),
            Scope::Study => self.of_study().to_owned(),
            Scope::Rollouts if shares_rollouts => self.root.clone(),
            Scope::Model => self.root.clone(),
            Scope::Rollouts | Scope::Deployment => self.of_deployed(),
        };
        parent.join(step.folder().unwrap_or_default())
    }

    /// Folder of the representation of the states.
    pub fn representation(&self) -> PathBuf {
        self.directory(StepKind::Represent)
    }

    /// Folder of the calibration model.
    pub fn model(&self) -> PathBuf {
        self.directory(StepKind::BuildModel)
    }

    /// Folder of the model's rollouts.
    pub fn rollout(&self) -> PathBuf {
        self.directory(StepKind::Rollout)
    }

    /// Folder of the prepared log; all models and deployments of the study share it.
    pub fn dataset(&self) -> PathBuf {
        self.directory(StepKind::Prepare)
    }

    /// Folder of the pre-trained agents; all models of the study share them.
    pub fn pretrain(&self) -> PathBuf {
        self.directory(StepKind::Pretrain)
    }

    /// Folder of the sweep's training runs.
    pub fn sweep(&self) -> PathBuf {
        self.directory(StepKind::Sweep)
    }

    /// Folder of the verdict about acting agents.
    pub fn control(&self) -> PathBuf {
        self.directory(StepKind::Control)
    }

    /// Folder of the model with actions, built from a log of decisions.
    pub fn control_model(&self) -> PathBuf {
        self.root.join("control-model")
    }

    /// Folder of the training runs of acting agents while their sweep is unfinished.
    pub fn control_units(&self) -> PathBuf {
        self.root.join("control-units")
    }

    /// Folder of the representation of the states of a log of decisions.
    pub fn control_representation(&self) -> PathBuf {
        self.root.join("control-representation")
    }

    /// Folder of the verdict and its figures.
    pub fn evaluate(&self) -> PathBuf {
        self.directory(StepKind::Evaluate)
    }

    /// Path of the report.
    pub fn report(&self) -> PathBuf {
        self.of_deployed().join("report.html")
    }
}

/// Returns the folders in `directory`, or an empty list if it does not exist.
fn folders(directory: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(directory).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).filter(|path| path.is_dir()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_deployment_has_results_of_its_own_but_no_model() {
        let study = Layout::new("s.toml".into(), "r".into());
        let paths = study.clone().of_model("m").of_deployment("april", Rollouts::OfDeployment);
        assert_eq!(paths.model(), Path::new("r/models/m/model"));
        assert_eq!(paths.pretrain(), Path::new("r/pretrain"));
        assert_eq!(paths.dataset(), Path::new("r/dataset"));
        assert_eq!(paths.rollout(), Path::new("r/models/m/deployments/april/rollout"));
        assert_eq!(paths.report(), Path::new("r/models/m/deployments/april/report.html"));
        let shared = study.of_deployment("april", Rollouts::OfModel);
        assert_eq!(shared.rollout(), Path::new("r/rollout"));
        assert_eq!(shared.sweep(), Path::new("r/deployments/april/sweep"));
    }

    #[test]
    fn sweeps_of_all_other_parts_are_found() {
        let directory = tempfile::tempdir().expect("a directory");
        let root = directory.path();
        let sweeps =
            ["sweep", "deployments/a/sweep", "models/m/sweep", "models/m/deployments/a/sweep"];
        for sweep in sweeps {
            std::fs::create_dir_all(root.join(sweep)).expect("writable");
        }
        let study = Layout::new("s.toml".into(), root.to_owned());
        let paths = study.of_model("m").of_deployment("a", Rollouts::OfModel);
        let others =
            ["deployments/a/sweep", "models/m/sweep", "sweep"].map(|sweep| root.join(sweep));
        assert_eq!(paths.other_sweeps(), others);
    }
}
