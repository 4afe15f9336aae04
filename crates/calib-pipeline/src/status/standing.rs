//! The status of a study or of a plan of shards, as data.

use std::path::{Path, PathBuf};

use calib_base::progress::{CommandState, Note};
use schemars::JsonSchema;
use serde::Serialize;

use super::ranking::Ranking;
use crate::{cluster, control::ControlRanking};

/// Status of a study or of a plan of shards.
#[derive(Debug, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum StandingOf {
    /// A study.
    Study(StudyStanding),
    /// A plan for a cluster.
    Cluster(ClusterStanding),
}

/// Status of a study.
#[derive(Debug, Serialize, JsonSchema)]
pub struct StudyStanding {
    pub(crate) study: PathBuf,
    pub(crate) results: PathBuf,
    pub(crate) state: Overall,
    /// Commands that are running, or were killed.
    pub(crate) commands: Vec<Command>,
    /// The command that completes the study, if all runs are finished and no command is running.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) next: Option<String>,
    /// Estimated seconds until the running commands are done, if known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) secs_left: Option<f64>,
    pub(crate) steps: Vec<StepStanding>,
    pub(crate) rankings: Vec<Ranking>,
    /// Current ranking of the settings of agents that act.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) control: Option<ControlRanking>,
    /// Path of the report, if it exists.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) report: Option<PathBuf>,
}

impl StudyStanding {
    /// Whether every step is up to date.
    pub fn is_done(&self) -> bool {
        self.state == Overall::Done
    }
}

/// Status of a plan for a cluster.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ClusterStanding {
    pub(crate) directory: PathBuf,
    pub(crate) cluster: cluster::Status,
    pub(crate) rankings: Vec<Ranking>,
}

/// Overall status of a study.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Overall {
    /// Every step is up to date.
    Done,
    /// A command is running.
    Running,
    /// A command was killed, and no other command is running.
    Killed,
    /// Steps are still to do, and no command is running.
    Waiting,
}

/// A command on the study.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct Command {
    pub(crate) standing: CommandState,
    #[serde(flatten)]
    pub(crate) note: Note,
}

/// A step for one model and deployment.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct StepStanding {
    pub(crate) step: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) model: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) deployment: Option<String>,
    pub(crate) state: StepState,
    /// Why the step is still to do, and the command to run, if known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) stale: Option<String>,
}

/// State of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum StepState {
    Done,
    Running,
    ToDo,
}

impl StandingOf {
    /// Whether a command is running, so that the status will change.
    pub fn is_running(&self) -> bool {
        match self {
            Self::Study(study) => study.state == Overall::Running,
            Self::Cluster(plan) => plan.cluster.is_running(),
        }
    }

    /// Returns the report of the study, if it exists.
    pub fn report(&self) -> Option<&Path> {
        match self {
            Self::Study(study) => study.report.as_deref(),
            Self::Cluster(_) => None,
        }
    }
}
