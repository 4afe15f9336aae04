//! The manifest of a model directory.

use calib_base::{
    artefact::{Artefact, Facts},
    log::profile_file::PROFILE,
};
use calib_core::{Frames, Normaliser, Period, Timestamp};
use calib_data::Dataset;
use calib_files::Fingerprint;
use calib_knn::Recall;
use calib_model::JumpStatistics;
use calib_study::{StepKind, Study};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{member_recurrence::MemberRecurrence, training_summary::TrainingSummary};

/// `manifest.json` of a model directory.
pub type ModelManifest = Artefact<ModelFacts>;

/// Description of a model in its manifest.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub struct ModelFacts {
    /// Fingerprint of the data and the configuration.
    pub(crate) key: String,
    /// The study as it was resolved.
    #[schemars(with = "calib_base::resolved::ResolvedStudy")]
    pub study: Study,
    /// Fingerprint of the states, timestamps and columns that the model was built from.
    pub(crate) data: Fingerprint,
    /// Time from one state to the next.
    pub period: Period,
    /// Number of states.
    pub rows: usize,
    pub(crate) transitions: usize,
    /// Number of segments without a gap.
    pub segments: usize,
    /// Times of the first and the last row.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub times: Option<[Timestamp; 2]>,
    pub(crate) normaliser: Normaliser,
    /// The search structure that found the tables, and the reason for it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) search: Option<String>,
    /// Recall of the tables, if they are approximate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) recall: Option<Recall>,
    /// One entry for each member of the ensemble.
    pub members: Vec<MemberSummary>,
    /// Training of the network, if the model is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) training: Option<TrainingSummary>,
}

impl ModelFacts {
    /// Returns the facts of a model of any kind that was built from the training states of `dataset`.
    pub(crate) fn of(
        key: String,
        study: &Study,
        dataset: &Dataset,
        transitions: usize,
        members: Vec<MemberSummary>,
    ) -> Self {
        Self {
            key,
            study: study.clone(),
            data: dataset.fingerprint.clone(),
            period: dataset.period,
            rows: dataset.train.rows(),
            transitions,
            segments: dataset.train.segments().len(),
            times: first_and_last(&dataset.train),
            normaliser: dataset.normaliser.clone(),
            search: None,
            recall: None,
            members,
            training: None,
        }
    }
}

impl Facts for ModelFacts {
    /// 2: models leave out transitions that would trap rollouts. 3: manifests carry fingerprints of themselves.
    const FORMAT: u32 = 3;
    const STEP: StepKind = StepKind::BuildModel;

    fn key(&self) -> &str {
        &self.key
    }

    fn lasts(name: &str) -> bool {
        name != PROFILE
    }
}

/// One ensemble member.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub struct MemberSummary {
    /// Number of transitions that it was built from.
    pub transitions: usize,
    /// Jumps of one rollout from a random start state; none for models that leave the data.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jumps: Option<JumpStatistics>,
    /// Whether its rollouts are trapped, and how far they get; none for models that leave the data.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) recurrence: Option<MemberRecurrence>,
}

/// Returns the times of the first and the last row.
pub fn first_and_last(frames: &Frames) -> Option<[Timestamp; 2]> {
    let times = frames.timestamps();
    Some([*times.first()?, *times.last()?])
}
