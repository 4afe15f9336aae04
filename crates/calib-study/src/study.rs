use std::{collections::BTreeMap, path::PathBuf};

use calib_agent::{AgentConfig, Part};
use calib_control::ControlConfig;
use calib_core::Seed;
use calib_data::{DataConfig, Description, PreprocessConfig, TimeRange};
use calib_dynamics::{DynamicsConfig, NOISE_VERSION, Noise};
use calib_model::{ModelFamily, RolloutConfig, StartKind};
use calib_represent::{RepresentationConfig, RepresentationKind};
use calib_sweep::{Rule, SweepConfig};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{ModelSection, PretrainConfig, SimulateConfig, schema};

/// A study file. Every key except `[data] path` and `[sweep] sensors` has a default.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Study {
    /// Seed of all random numbers (default 0).
    pub seed: u64,
    /// Where results go, relative to the study file (default: the file's name without `.toml`,
    /// followed by `-results`).
    pub output: Option<PathBuf>,
    /// The plant that the log is simulated from, if it is; unused if `--set` names other data.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub simulate: Option<SimulateConfig>,
    /// Where the log is, and which part of it is training and which is held out.
    pub data: DataConfig,
    /// Variants of the study at other sizes, by name: each replaces some of its keys. Empty after one was chosen.
    #[serde(skip_serializing)]
    #[schemars(schema_with = "schema::profiles")]
    pub profiles: BTreeMap<String, toml::Table>,
    /// Names of the models to compare (default: all).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub compare: Option<Vec<String>>,
    /// Models to compare, by name: each replaces some keys of the study. Empty after one was chosen.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    #[schemars(schema_with = "schema::models")]
    pub models: BTreeMap<String, toml::Table>,
    /// Named times of deployment, each with a held-out period. Empty after one was chosen, which is then `data.held_out`.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub deployments: BTreeMap<String, TimeRange>,
    /// Labels and units of sensors, by name. Default: those in the header of the log.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub sensors: BTreeMap<String, Description>,
    /// Preprocessing: from the log to states.
    pub preprocess: PreprocessConfig,
    /// The space in which neighbours are searched.
    pub representation: RepresentationConfig,
    /// The calibration model.
    pub model: ModelSection,
    /// Networks, for models of this kind.
    pub dynamics: DynamicsConfig,
    /// Rollouts of the model, and the start states of sweeps.
    pub rollout: RolloutConfig,
    /// The agent. It is also the default that a sweep compares with.
    pub agent: AgentConfig,
    /// Agents that learn from the log before deployment.
    pub pretrain: PretrainConfig,
    /// An agent that acts, tuned on a log with actions. It is used by `calib control` and `calib run`, and `calib init` writes
    /// it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub control: Option<ControlConfig>,
    /// The hyperparameters to sweep.
    pub sweep: SweepConfig,
    /// How a setting is chosen and judged.
    pub evaluate: EvaluateConfig,
}

impl Study {
    /// Returns the root of the seeds of all rollouts.
    pub fn seed_of_rollouts(&self) -> Seed {
        Seed::new(self.seed).child("rollout")
    }

    /// Returns the noise that rollouts add to the predictions of the study's network, if any.
    pub fn rollout_noise(&self) -> Option<Noise> {
        let noise = self.dynamics.noise;
        match self.model.kind.family() {
            ModelFamily::Network if noise != Noise::None => Some(noise),
            ModelFamily::Network | ModelFamily::Neighbors | ModelFamily::None => None,
        }
    }

    /// Returns what keys of rollouts and streams contain about that noise: its kind and its version.
    pub fn rollout_noise_inputs(&self) -> Option<(Noise, u32)> {
        self.rollout_noise().map(|noise| (noise, NOISE_VERSION))
    }

    /// Whether the study is about an acting agent only, without predictions.
    pub fn is_of_acting_agents(&self) -> bool {
        self.control.is_some() && self.sweep.sensors.is_empty()
    }

    /// Whether the study has a calibration model. Without one, only log replay chooses.
    pub fn has_model(&self) -> bool {
        self.model.kind.family() != ModelFamily::None
    }

    /// Returns the number of members of the model: blocks of an ensemble of neighbours, or one network; 0 without a model.
    pub fn members(&self) -> usize {
        match self.model.kind.family() {
            ModelFamily::Neighbors => self.model.members,
            ModelFamily::Network => 1,
            ModelFamily::None => 0,
        }
    }

    /// Whether neighbours are searched in a representation of the states.
    pub fn has_representation(&self) -> bool {
        self.model.kind.family() == ModelFamily::Neighbors
            && self.representation.kind != RepresentationKind::None
    }

    /// Returns the training runs per setting and member of the model; 0 without a model.
    pub fn member_runs(&self) -> usize {
        match self.model.kind.family() {
            ModelFamily::Neighbors => self.sweep.member_runs,
            ModelFamily::Network => self.sweep.runs_of_network(),
            ModelFamily::None => 0,
        }
    }

    /// Whether the start states of `[rollout]` follow from the deployment; false without a model.
    pub fn starts_follow_from_deployment(&self) -> bool {
        self.follows_from_deployment(self.rollout.start)
    }

    /// Whether the start states of training rollouts follow from the deployment; false without a model.
    pub fn sweep_starts_follow_from_deployment(&self) -> bool {
        self.follows_from_deployment(self.sweep_starts().start)
    }

    fn follows_from_deployment(&self, start: StartKind) -> bool {
        match start {
            StartKind::Nearest | StartKind::CalendarMonth | StartKind::Recent => self.has_model(),
            StartKind::Random | StartKind::Rows => false,
        }
    }

    /// Returns the start states of training rollouts. No other key of `[rollout]` affects them.
    pub fn sweep_starts(&self) -> RolloutConfig {
        let own = self.sweep.start.unwrap_or(self.rollout.start);
        RolloutConfig { start: own, ..self.rollout.starts() }
    }

    /// Returns the distinct discount factors of the predicted sensors, in the order of the sensors. Returns that of `[agent]`
    /// if no sensor is predicted.
    pub fn gammas(&self) -> Vec<f64> {
        let Self { agent, sweep, .. } = self;
        let mut gammas: Vec<f64> = Vec::new();
        for gamma in sweep.sensors.iter().map(|sensor| agent.gamma_for(sensor)) {
            if !gammas.contains(&gamma) {
                gammas.push(gamma);
            }
        }
        if gammas.is_empty() {
            gammas.push(agent.gamma);
        }
        gammas
    }

    /// Returns the predicted sensors whose return has this discount factor.
    pub fn sensors_of(&self, gamma: f64) -> impl Iterator<Item = &String> {
        let Self { agent, sweep, .. } = self;
        sweep.sensors.iter().filter(move |sensor| agent.gamma_for(sensor) == gamma)
    }

    /// Returns the scored part of a training run: the one in the study, or a default. By default, agents that start from
    /// scratch are scored on the whole run, because learning is part of their deployment. Fine-tuned agents: the final quarter
    /// (the paper).
    pub fn part(&self) -> Part {
        let usual = if self.pretrain.is_on() { Part::FinalQuarter } else { Part::WholeRun };
        self.sweep.scored.unwrap_or(usual)
    }

    /// Returns the name in figures and tables of the model, or of the method that chooses without a model.
    pub fn model_name(&self) -> &'static str {
        match (self.model.kind.family(), self.representation.kind) {
            (ModelFamily::Network | ModelFamily::None, _) => self.model.kind.label(),
            (ModelFamily::Neighbors, RepresentationKind::None) => "Euclidean kNN",
            (ModelFamily::Neighbors, RepresentationKind::Laplacian) => "Laplacian kNN",
            (ModelFamily::Neighbors, RepresentationKind::Import) => {
                "kNN in an imported representation"
            }
        }
    }
}

/// The `[evaluate]` section.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct EvaluateConfig {
    /// How a setting is chosen from the evidence (default: `pooled`; `log_replay` without a model).
    pub rule: Rule,
    /// Number of bootstrap resamples for intervals (default 2000; 0 for no intervals).
    pub resamples: usize,
    /// The choice counts as a hit if it is among the best `top_k` settings on held-out data (default 3).
    pub top_k: usize,
    /// Title of the report (default: the study file's name).
    pub title: Option<String>,
    /// A CSV file with the tags, their units and descriptions, relative to the study file (default: none).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tags: Option<PathBuf>,
}

impl Default for EvaluateConfig {
    fn default() -> Self {
        Self { rule: Rule::Pooled, resamples: 2000, top_k: 3, title: None, tags: None }
    }
}
