//! A study: one TOML file that says what to compute, checked before anything runs.

mod deployments;
mod load;
mod message;
mod model;
mod models;
mod overlay;
mod partition;
mod paths;
mod pretrain;
mod profiles;
mod protocol;
mod simulate;
mod toml_json;

use std::{collections::BTreeMap, path::PathBuf};

use calib_agent::{AgentConfig, Part};
use calib_data::{DataConfig, PreprocessConfig, TimeRange};
use calib_dynamics::DynamicsConfig;
use calib_knn::ModelKind;
use calib_represent::{RepresentationConfig, RepresentationKind};
use calib_rollout::RolloutConfig;
use calib_sweep::{Beginning, Rule, SweepConfig};
use serde::{Deserialize, Serialize};

pub(crate) use load::{Chosen, UnsetVariable, working_files};
pub(crate) use model::ModelSection;
pub(crate) use partition::Partition;
pub(crate) use paths::Rollouts;
pub use paths::StudyPaths;
pub(crate) use pretrain::{MomentsRule, PretrainConfig};
pub(crate) use protocol::{Drawn, Protocol};
pub(crate) use simulate::SimulateConfig;

/// A study file. Every key has a default but `[data] path` and `[sweep] sensors`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Study {
    /// Root of all randomness (default 0).
    pub seed: u64,
    /// Where results go, relative to the study file (default: the file's name without `.toml`,
    /// followed by `-results`).
    pub output: Option<PathBuf>,
    /// The plant that the log is simulated from, if it is; unused where `--set` names other data.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub simulate: Option<SimulateConfig>,
    /// Where the log is, and which part of it is training and which is held out.
    pub data: DataConfig,
    /// The same study at other sizes, by name: what replaces the rest of it; empty once one was chosen, or none.
    #[serde(skip_serializing)]
    pub profiles: BTreeMap<String, toml::Table>,
    /// Which of the models are compared (default: all).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub compare: Option<Vec<String>>,
    /// How models that are to be compared differ from the rest of the study, by name; empty where one was chosen.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub models: BTreeMap<String, toml::Table>,
    /// Named test windows; empty where one was chosen, which is then `data.held_out`.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub deployments: BTreeMap<String, TimeRange>,
    /// From log to states.
    pub preprocess: PreprocessConfig,
    /// What neighbours are searched in.
    pub representation: RepresentationConfig,
    /// The calibration model.
    pub model: ModelSection,
    /// Networks, where the model is one.
    pub dynamics: DynamicsConfig,
    /// Rollouts of the model, and the start states of sweeps.
    pub rollout: RolloutConfig,
    /// The agent, and so the default that a sweep compares with.
    pub agent: AgentConfig,
    /// Agents that have learnt from the log before they are deployed.
    pub pretrain: PretrainConfig,
    /// What to sweep.
    pub sweep: SweepConfig,
    /// How to judge.
    pub evaluate: EvaluateConfig,
}

impl Study {
    /// Whether the model is a network, to which `[dynamics]` applies.
    pub fn is_parametric(&self) -> bool {
        self.model.kind != ModelKind::Knn
    }

    /// Runs of every value in each member of the model.
    pub(crate) fn member_runs(&self) -> usize {
        if self.is_parametric() { self.sweep.runs_of_network() } else { self.sweep.member_runs }
    }

    /// Where the rollouts start that agents are trained in; nothing else of `[rollout]` decides about them.
    pub(crate) fn sweep_starts(&self) -> RolloutConfig {
        let own = self.sweep.start.unwrap_or(self.rollout.start);
        RolloutConfig { start: own, ..self.rollout.starts() }
    }

    /// Which part of a run is scored.
    pub(crate) fn part(&self) -> Part {
        let tuned = self.pretrain.epochs > 0 || self.pretrain.checkpoint.is_some();
        self.sweep.part(if tuned { Beginning::Pretrained } else { Beginning::Scratch })
    }

    /// What the model is called in figures and tables.
    pub(crate) fn model_name(&self) -> &'static str {
        match (self.model.kind, self.representation.kind) {
            (ModelKind::Nn, _) => "NN",
            (ModelKind::Gru, _) => "GRU",
            (ModelKind::Torchscript, _) => "TorchScript model",
            (ModelKind::Knn, RepresentationKind::None) => "Euclidean kNN",
            (ModelKind::Knn, RepresentationKind::Laplacian) => "Laplacian kNN",
            (ModelKind::Knn, RepresentationKind::Import) => "kNN in an imported representation",
        }
    }
}

/// The `[evaluate]` section.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EvaluateConfig {
    /// How a value is chosen from the evidence (default: `pooled`).
    pub rule: Rule,
    /// Resamples of intervals (default 2000; 0 gives none).
    pub resamples: usize,
    /// The choice counts as a hit if it is among the best `top_k` Online (default 3).
    pub top_k: usize,
    /// Title of the report (default: the study file's name).
    pub title: Option<String>,
}

impl Default for EvaluateConfig {
    fn default() -> Self {
        Self { rule: Rule::Pooled, resamples: 2000, top_k: 3, title: None }
    }
}
