//! The answer of `validity`: how well calib chooses, over several studies.

use std::path::{Path, PathBuf};

use calib_agent::Part;
use calib_base::artefact::TOOL;
use calib_study::Share;
use calib_validity::Validity;
use schemars::JsonSchema;
use serde::Serialize;

use super::task::Task;

/// `validity.json`.
#[derive(Serialize, JsonSchema)]
pub(crate) struct Summary<'a> {
    format: u32,
    tool: &'static str,
    /// The protocol that drew the plants and tasks.
    #[serde(skip_serializing_if = "Option::is_none")]
    protocol: Option<&'a Drew>,
    /// The plants that were judged.
    plants: &'a [Judged],
    /// Plants that were not judged, each with the reason.
    left_out: &'a [LeftOut],
    /// Missing models, each with the reason.
    missing: &'a [String],
    /// Results by each score. The first is the score of the studies.
    scores: &'a [Score],
}

/// The protocol that drew the plants.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct Drew {
    /// Name of its file.
    pub(super) file: String,
    pub(super) seed: u64,
}

/// A plant with its task.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct Judged {
    pub(super) plant: String,
    #[serde(flatten)]
    pub(super) task: Task,
}

/// A plant that is not judged.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub(crate) struct LeftOut {
    pub(super) plant: String,
    pub(super) reason: String,
}

/// Results over all pairs, by the errors over one part of each run.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct Score {
    pub(super) part: Part,
    #[serde(flatten)]
    pub(super) validity: Validity,
}

/// The result of `validity`.
#[derive(Debug)]
pub enum ValidityAnswer {
    /// All studies, judged together.
    Judged(Box<JudgedStudies>),
    /// The plants of a share were run, and nothing is judged.
    Shared(SharedPlants),
}

/// All studies, judged together.
#[derive(Debug)]
pub struct JudgedStudies {
    pub(super) protocol: Option<Drew>,
    pub(super) plants: Vec<Judged>,
    pub(super) left_out: Vec<LeftOut>,
    pub(super) missing: Vec<String>,
    /// At least one score.
    pub(super) scores: Vec<Score>,
    pub(super) command: String,
    pub(super) report: PathBuf,
}

/// The plants of one of several processes that share the studies.
#[derive(Debug)]
pub struct SharedPlants {
    pub(super) share: Share,
    pub(super) plants: usize,
    pub(super) left_out: Vec<LeftOut>,
}

impl JudgedStudies {
    /// Returns what `validity.json` holds.
    pub(super) fn summary(&self) -> Summary<'_> {
        Summary {
            format: 3,
            tool: TOOL,
            protocol: self.protocol.as_ref(),
            plants: &self.plants,
            left_out: &self.left_out,
            missing: &self.missing,
            scores: &self.scores,
        }
    }

    /// Returns how well each method chooses, by the score of the studies.
    pub fn validity(&self) -> &Validity {
        &self.scores[0].validity
    }

    /// Returns the judged plants.
    pub fn plants(&self) -> Vec<&str> {
        self.plants.iter().map(|judged| judged.plant.as_str()).collect()
    }

    /// Returns the plants that were left out, each with the reason.
    pub fn left_out(&self) -> Vec<[&str; 2]> {
        named(&self.left_out)
    }

    /// Returns the path of the report.
    pub fn report(&self) -> &Path {
        &self.report
    }
}

impl SharedPlants {
    /// Returns the number of plants in the share.
    pub fn plants(&self) -> usize {
        self.plants
    }

    /// Returns the plants that were not run, each with the reason.
    pub fn left_out(&self) -> Vec<[&str; 2]> {
        named(&self.left_out)
    }
}

fn named(left_out: &[LeftOut]) -> Vec<[&str; 2]> {
    left_out.iter().map(|plant| [plant.plant.as_str(), plant.reason.as_str()]).collect()
}
