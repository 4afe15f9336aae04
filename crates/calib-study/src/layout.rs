use std::path::{Path, PathBuf};

use crate::{Scope, StepKind};

/// Where the files of a study lie.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    study: PathBuf,
    /// Of the study, or of one of its models.
    root: PathBuf,
    model: Option<String>,
    deployment: Option<(String, Rollouts)>,
}

/// Whose rollouts a deployment has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rollouts {
    /// Its own, because start states follow from it.
    OfDeployment,
    /// Those of the model, which are the same for every deployment.
    OfModel,
}

impl Layout {
    /// The layout below `root` of the results of the file `study`.
    pub fn new(study: PathBuf, root: PathBuf) -> Self {
        Self { study, root, model: None, deployment: None }
    }

    /// The layout of one of several models of the study.
    #[must_use]
    pub fn of_model(self, name: &str) -> Self {
        let root = self.root.join("models").join(name);
        Self { root, model: Some(name.to_owned()), ..self }
    }

    /// The layout of one of several deployments of the study, or of one of its models.
    #[must_use]
    pub fn of_deployment(self, name: &str, rollouts: Rollouts) -> Self {
        Self { deployment: Some((name.to_owned(), rollouts)), ..self }
    }

    /// The directories of what a step makes for the study's other models, each model by itself.
    pub fn of_other_models(&self, step: StepKind) -> Vec<PathBuf> {
        let roots = folders(&self.of_study().join("models")).into_iter();
        let roots = roots.filter(|root| *root != self.root);
        let mut all: Vec<PathBuf> =
            roots.map(|root| root.join(step.folder().unwrap_or_default())).collect();
        all.sort();
        all
    }

    /// The sweeps of the study's other models and deployments, as far as there are any.
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

    /// Whose rollouts the deployment has, of several.
    pub(crate) fn rollouts(&self) -> Option<Rollouts> {
        self.deployment.as_ref().map(|(_, rollouts)| *rollouts)
    }

    /// The directory of all results of the study, all models and deployments.
    pub fn of_study(&self) -> &Path {
        match self.model {
            Some(_) => self.root.ancestors().nth(2).unwrap_or(&self.root),
            None => &self.root,
        }
    }

    /// The directory of what follows from the deployment.
    fn of_deployed(&self) -> PathBuf {
        match &self.deployment {
            Some((name, _)) => self.root.join("deployments").join(name),
            None => self.root.clone(),
        }
    }

    /// The study file.
    pub fn study(&self) -> &Path {
        &self.study
    }

    /// The directory of all results.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The directory of what a step makes; of a simulated log, which lies where the study says, that of all results.
    pub fn directory(&self, step: StepKind) -> PathBuf {
        let shares_rollouts = matches!(self.deployment, Some((_, Rollouts::OfModel)));
        let parent = match step.scope() {
            // What acts has no part in the models that are compared, and a study of one has no others.
            Scope::Study if step == StepKind::Control => self.root.clone(),
            Scope::Study => self.of_study().to_owned(),
            Scope::Rollouts if shares_rollouts => self.root.clone(),
            Scope::Model => self.root.clone(),
            Scope::Rollouts | Scope::Deployment => self.of_deployed(),
        };
        parent.join(step.folder().unwrap_or_default())
    }

    /// Representations of the states.
    pub fn representation(&self) -> PathBuf {
        self.directory(StepKind::Represent)
    }

    /// The calibration model.
    pub fn model(&self) -> PathBuf {
        self.directory(StepKind::BuildModel)
    }

    /// Rollouts of the model.
    pub fn rollout(&self) -> PathBuf {
        self.directory(StepKind::Rollout)
    }

    /// Logs as they were prepared; all models and deployments of the study share them.
    pub fn dataset(&self) -> PathBuf {
        self.directory(StepKind::Prepare)
    }

    /// Pre-trained agents; the models of a study share them.
    pub fn pretrain(&self) -> PathBuf {
        self.directory(StepKind::Pretrain)
    }

    /// Runs of the sweep.
    pub fn sweep(&self) -> PathBuf {
        self.directory(StepKind::Sweep)
    }

    /// The verdict about agents that act.
    pub fn control(&self) -> PathBuf {
        self.directory(StepKind::Control)
    }

    /// The model with actions of a log of decisions.
    pub fn control_model(&self) -> PathBuf {
        self.root.join("control-model")
    }

    /// Runs of agents that act, while a sweep of them is not finished.
    pub fn control_units(&self) -> PathBuf {
        self.root.join("control-units")
    }

    /// The representation of the states of a log of decisions.
    pub fn control_representation(&self) -> PathBuf {
        self.root.join("control-representation")
    }

    /// Verdict and figures.
    pub fn evaluate(&self) -> PathBuf {
        self.directory(StepKind::Evaluate)
    }

    /// The report.
    pub fn report(&self) -> PathBuf {
        self.of_deployed().join("report.html")
    }
}

/// The folders in `directory`, none if it does not exist.
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
