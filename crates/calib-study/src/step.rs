//! The list of the steps from a log to a verdict.

use serde::{Serialize, Serializer};

use crate::Study;

/// A step from a log to a verdict, in the order in which a study needs them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum StepKind {
    /// Writes the log of the plant that the study describes.
    Simulate,
    /// Reads and cleans the log.
    Prepare,
    /// Trains one agent per sensor on a part of the log.
    Pretrain,
    /// Trains or imports representations of the states.
    Represent,
    /// Builds the calibration model.
    BuildModel,
    /// Computes rollouts of the model.
    Rollout,
    /// Trains agents for every setting of the grid.
    Sweep,
    /// Judges the sweep, and writes the report.
    Evaluate,
    /// All steps for acting agents, from their log to their verdict.
    Control,
}

/// The parts of a study for which a step runs once each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// Once for the study, whatever its models and deployments.
    Study,
    /// Once per model.
    Model,
    /// Once per model, and once per deployment if the start states follow from the deployment.
    Rollouts,
    /// Once per deployment and model.
    Deployment,
}

impl StepKind {
    /// All steps.
    pub const ALL: [Self; 9] = [
        Self::Simulate,
        Self::Prepare,
        Self::Pretrain,
        Self::Represent,
        Self::BuildModel,
        Self::Rollout,
        Self::Sweep,
        Self::Evaluate,
        Self::Control,
    ];

    /// The steps that run separately for each model of a study.
    pub const OF_MODELS: [Self; 4] =
        [Self::Represent, Self::BuildModel, Self::Rollout, Self::Sweep];

    /// Returns the command that runs the step. No command only prepares a log: `run` begins with that.
    pub const fn command(self) -> &'static str {
        match self {
            Self::Simulate => "simulate",
            Self::Prepare => "run",
            Self::Pretrain => "pretrain",
            Self::Represent => "represent",
            Self::BuildModel => "build-model",
            Self::Rollout => "rollout",
            Self::Sweep => "sweep",
            Self::Evaluate => "evaluate",
            Self::Control => "control",
        }
    }

    /// Returns the step that a command runs. The command may have hyphens or underscores.
    pub fn of_command(command: &str) -> Option<Self> {
        let command = command.replace('_', "-");
        Self::ALL.into_iter().find(|step| step.command() == command)
    }

    /// Returns the step whose results are in a folder of this name.
    pub fn of_folder(folder: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|step| step.folder() == Some(folder))
    }

    /// Returns the label of the step in lists.
    pub const fn label(self) -> &'static str {
        match self {
            Self::Prepare => "reading the log",
            step => step.command(),
        }
    }

    /// Returns the noun for the step's result in a sentence.
    pub const fn result(self) -> &'static str {
        match self {
            Self::Simulate => "log",
            Self::Prepare => "states",
            Self::Pretrain => "agents",
            Self::Represent => "representation",
            Self::BuildModel => "model",
            Self::Rollout => "rollouts",
            Self::Sweep => "sweep",
            Self::Evaluate | Self::Control => "verdict",
        }
    }

    /// Whether [`result`](Self::result) is a plural.
    pub const fn is_plural(self) -> bool {
        matches!(self, Self::Prepare | Self::Pretrain | Self::Rollout)
    }

    /// Returns the parts of a study for which the step runs once each.
    pub const fn scope(self) -> Scope {
        match self {
            Self::Simulate | Self::Prepare | Self::Pretrain | Self::Control => Scope::Study,
            Self::Represent | Self::BuildModel => Scope::Model,
            Self::Rollout => Scope::Rollouts,
            Self::Sweep | Self::Evaluate => Scope::Deployment,
        }
    }

    /// Returns the name of the step's result folder; `None` for a simulated log, whose path the study gives.
    pub const fn folder(self) -> Option<&'static str> {
        match self {
            Self::Simulate => None,
            Self::Prepare => Some("dataset"),
            Self::Pretrain => Some("pretrain"),
            Self::Represent => Some("representation"),
            Self::BuildModel => Some("model"),
            Self::Rollout => Some("rollout"),
            Self::Sweep => Some("sweep"),
            Self::Evaluate => Some("evaluate"),
            Self::Control => Some("control"),
        }
    }

    /// Returns the steps whose results this step reads, if the study needs them.
    pub const fn prerequisites(self) -> &'static [Self] {
        match self {
            Self::Simulate => &[],
            Self::Prepare | Self::Control => &[Self::Simulate],
            Self::Pretrain | Self::Represent => &[Self::Prepare],
            Self::BuildModel => &[Self::Prepare, Self::Represent],
            Self::Rollout => &[Self::BuildModel],
            // `Prepare` is listed because a study may need neither of the others.
            Self::Sweep => &[Self::Prepare, Self::BuildModel, Self::Pretrain],
            Self::Evaluate => &[Self::Rollout, Self::Sweep],
        }
    }

    /// Returns the steps that can follow this one, the usual one first.
    pub const fn next(self) -> &'static [Self] {
        match self {
            Self::Simulate => &[Self::Prepare],
            Self::Prepare | Self::Represent => &[Self::BuildModel],
            Self::Pretrain => &[Self::BuildModel, Self::Sweep],
            Self::BuildModel => &[Self::Rollout, Self::Sweep],
            Self::Rollout => &[Self::Sweep],
            Self::Sweep => &[Self::Evaluate],
            Self::Evaluate | Self::Control => &[],
        }
    }
}

/// Serialises the step as its label.
impl Serialize for StepKind {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.label())
    }
}

impl Study {
    /// Whether the verdict of this study needs the step.
    pub fn needs(&self, step: StepKind) -> bool {
        match step {
            StepKind::Simulate => self.simulate.is_some(),
            StepKind::Pretrain => self.pretrain.epochs > 0 && self.pretrain.checkpoint.is_none(),
            StepKind::Represent => self.has_representation(),
            StepKind::BuildModel | StepKind::Rollout => self.has_model(),
            StepKind::Prepare | StepKind::Sweep | StepKind::Evaluate => true,
            StepKind::Control => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Job, Request};

    #[test]
    fn prerequisites_come_first_and_what_follows_comes_later() {
        for step in StepKind::ALL {
            assert!(step.prerequisites().iter().all(|before| *before < step), "{step:?}");
            assert!(step.next().iter().all(|after| *after > step), "{step:?}");
        }
        assert!(StepKind::ALL.is_sorted());
    }

    /// Returns the commands of the steps that a study needs, and its job.
    fn needed(text: &str) -> (String, Job) {
        let request = Request::new("s.toml");
        let job = Job::of_text(request, text.to_owned()).expect("valid");
        let steps = StepKind::ALL.into_iter().filter(|step| job.study().needs(*step));
        (steps.map(StepKind::command).collect::<Vec<_>>().join(" "), job)
    }

    #[test]
    fn a_study_without_a_model_has_no_steps_of_one() {
        let all = "run build-model rollout sweep evaluate";
        assert_eq!(needed("").0, all);
        let pretrained = "[pretrain]\nepochs = 3\n";
        let (steps, job) = needed(&format!("{pretrained}[model]\nkind = \"none\"\n"));
        assert_eq!(steps, "run pretrain sweep evaluate");
        assert_eq!(job.next_commands(StepKind::Pretrain), ["calib sweep s.toml"]);
        let with_model = needed(pretrained).1;
        let next = ["calib build-model s.toml", "calib sweep s.toml"];
        assert_eq!(with_model.next_commands(StepKind::Pretrain), next);
    }

    #[test]
    fn every_folder_is_of_one_step() {
        let mut folders: Vec<_> = StepKind::ALL.iter().filter_map(|step| step.folder()).collect();
        let all = folders.len();
        folders.sort_unstable();
        folders.dedup();
        assert_eq!(folders.len(), all);
    }
}
