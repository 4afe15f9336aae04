//! What a result follows from: the one notion of "the same" that every step asks.

use std::{collections::BTreeMap, fmt};

use calib_control::Distance;
use calib_dynamics::DynamicsConfig;
use calib_knn::{IndexKind, ModelConfig, WeightsKind};
use calib_model::{ModelFamily, ModelKind};
use calib_represent::RepresentationKind;
use serde::Serialize;
use serde_json::Value;

use crate::{StepKind, Study, overrides};

/// The keys of a study that a result follows from, each with its value. What changes no byte of it is not among them: the
/// folder that the log lies in (the log is known by its fingerprint), the search structure, what another kind of model uses.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Inputs(BTreeMap<String, Value>);

/// A key that a result follows from, and that has another value now.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// Such as `agent.gamma`.
    pub key: String,
    /// What the result was made with; nothing if the study did not have the key.
    pub made: Option<Value>,
    /// What the study says now.
    pub now: Option<Value>,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { key, made, now } = self;
        write!(f, "{key} = {}, now {}", told(made.as_ref()), told(now.as_ref()))
    }
}

/// The value as JSON, or that there is none.
fn told(value: Option<&Value>) -> String {
    value.map_or_else(|| "nothing".to_owned(), ToString::to_string)
}

impl Study {
    /// What the result of a step follows from.
    pub fn inputs(&self, step: StepKind) -> Inputs {
        let mut inputs = Inputs::default();
        match step {
            StepKind::Simulate => inputs.add("simulate", &self.simulate),
            StepKind::Prepare => inputs.prepared(self),
            StepKind::Pretrain => inputs.pretrained(self),
            StepKind::Represent => inputs.represented(self),
            StepKind::BuildModel => inputs.modelled(self),
            StepKind::Rollout => inputs.rolled_out(self),
            StepKind::Sweep => inputs.swept(self),
            StepKind::Evaluate => {
                inputs.swept(self);
                inputs.add("evaluate", &self.evaluate);
            }
            StepKind::Control => inputs.acted(self),
        }
        inputs
    }

    /// The keys in which a result of `step` that was made of the study `made` would be another one now.
    pub fn differences(&self, step: StepKind, made: &Self) -> Vec<Difference> {
        self.inputs(step).differences(&made.inputs(step))
    }
}

impl Inputs {
    /// Where these differ from those that something was `made` with, in the order of the keys.
    fn differences(&self, made: &Self) -> Vec<Difference> {
        let keys: std::collections::BTreeSet<&String> =
            self.0.keys().chain(made.0.keys()).collect();
        keys.into_iter()
            .filter_map(|key| {
                let made = made.0.get(key).cloned();
                let now = self.0.get(key).cloned();
                (made != now).then(|| Difference { key: key.clone(), made, now })
            })
            .collect()
    }

    /// Every key of a section, or of the table at `key`.
    fn add(&mut self, key: &str, section: &impl Serialize) {
        // A study that was read can be written.
        let value = serde_json::to_value(section).unwrap_or_default();
        self.flatten(key.to_owned(), value);
    }

    fn flatten(&mut self, key: String, value: Value) {
        match value {
            Value::Object(keys) => {
                for (name, value) in keys {
                    self.flatten(format!("{key}.{name}"), value);
                }
            }
            Value::Null => {}
            value => {
                self.0.insert(key, value);
            }
        }
    }

    fn remove(&mut self, keys: &[&str]) {
        self.0.retain(|key, _| !keys.iter().any(|parent| overrides::is_inside(key, parent)));
    }

    /// A log as it is cleaned. Where it lies does not matter: its content is known by its fingerprint.
    fn prepared(&mut self, study: &Study) {
        self.add("data", &study.data);
        self.remove(&["data.path"]);
        self.add("preprocess", &study.preprocess);
    }

    /// The states that everything is learnt from.
    fn training(&mut self, study: &Study) {
        self.prepared(study);
        self.remove(&["data.held_out"]);
        if study.data.train.is_some() {
            self.remove(&["data.train_fraction"]);
        }
        self.add("model.period", &study.model.period);
        if study.pretrain.is_on() {
            self.add("pretrain.period", &study.pretrain.period);
            if study.pretrain.period.is_none() && study.model.period.is_none() {
                self.add("pretrain.fraction", &study.pretrain.fraction);
            }
        }
    }

    fn represented(&mut self, study: &Study) {
        self.training(study);
        self.add("representation", &study.representation);
        self.add("seed", &study.seed);
    }

    fn modelled(&mut self, study: &Study) {
        self.training(study);
        self.add("model.kind", &study.model.kind);
        match study.model.kind.family() {
            ModelFamily::Neighbors => self.of_neighbors(study),
            ModelFamily::Network => self.of_network(study),
            ModelFamily::None => {}
        }
    }

    fn of_neighbors(&mut self, study: &Study) {
        self.add("model", &ModelConfig { index: IndexKind::Auto, ..*study.model });
        if study.model.weights != WeightsKind::Softmax {
            self.remove(&["model.temperature"]);
        }
        if study.representation.kind != RepresentationKind::None {
            self.represented(study);
        }
    }

    /// What the kind of network does not use is left out.
    fn of_network(&mut self, study: &Study) {
        let unused = DynamicsConfig::default();
        match study.model.kind {
            ModelKind::Torchscript => self.add("dynamics.path", &study.dynamics.path),
            kind => {
                self.add("dynamics", &DynamicsConfig { path: None, ..study.dynamics.clone() });
                self.add("seed", &study.seed);
                if kind == ModelKind::Nn {
                    self.add("dynamics.sequence_length", &unused.sequence_length);
                    self.add("dynamics.sequence_stride", &unused.sequence_stride);
                }
            }
        }
    }

    fn pretrained(&mut self, study: &Study) {
        self.training(study);
        let pretrain = &study.pretrain;
        self.add("agent", &pretrain.agent(&study.agent));
        self.remove(&["agent.learning_rate"]);
        self.add("pretrain", pretrain);
        // How fine-tuning begins; and what was taken from elsewhere is known by what it is.
        self.remove(&["pretrain.moments", "pretrain.checkpoint"]);
        if pretrain.period.is_some() || study.model.period.is_some() {
            self.remove(&["pretrain.fraction"]);
        }
        self.add("seed", &study.seed);
    }

    fn rolled_out(&mut self, study: &Study) {
        self.modelled(study);
        self.add("rollout", &study.rollout);
        self.add("sweep.sensors", &study.sweep.sensors);
        self.add("seed", &study.seed);
        if study.starts_follow_from_deployment() {
            self.held_out(study);
        }
    }

    fn swept(&mut self, study: &Study) {
        self.modelled(study);
        self.held_out(study);
        self.add("agent", &study.agent);
        self.remove(&["agent.timeout_secs"]);
        self.add("sweep", &study.sweep);
        // As `rollout.start` here, whichever of both says so.
        self.remove(&["sweep.start"]);
        if study.has_model() {
            self.add("rollout", &study.sweep_starts());
            // Only the starts of rollouts: their lengths and numbers are the sweep's own.
            self.remove(&["rollout.steps", "rollout.rollouts", "rollout.dtw_steps"]);
        } else {
            self.remove(&["sweep.member_runs", "sweep.network_runs"]);
        }
        if study.pretrain.is_on() {
            self.add("pretrain", &study.pretrain);
            if study.pretrain.period.is_some() || study.model.period.is_some() {
                self.remove(&["pretrain.fraction"]);
            }
        }
        self.add("seed", &study.seed);
    }

    /// A verdict about agents that act. Nothing is held out of a log of decisions, and it has models of its own.
    fn acted(&mut self, study: &Study) {
        self.prepared(study);
        self.remove(&["data.held_out"]);
        if study.data.train.is_some() {
            self.remove(&["data.train_fraction"]);
        }
        self.add("control", &study.control);
        let model = study.control.as_ref().map(|control| &control.model);
        if model.is_some_and(|model| model.distance == Distance::Laplacian) {
            self.add("representation", &study.representation);
            // It says what a model without actions has.
            self.remove(&["representation.kind"]);
        }
        if study.is_of_acting_agents() && study.agent.is_external() {
            self.add("agent.command", &study.agent.command);
            self.add("agent.gamma", &study.agent.gamma);
            self.add("agent.parameters", &study.agent.parameters);
            self.add("sweep.grid", &study.sweep.grid);
            self.add("sweep.sampling", &study.sweep.sampling);
            self.add("sweep.samples", &study.sweep.samples);
        }
        self.add("seed", &study.seed);
        self.add("evaluate.resamples", &study.evaluate.resamples);
    }

    /// What stands for the deployment.
    fn held_out(&mut self, study: &Study) {
        self.add("data.held_out", &study.data.held_out);
    }
}

#[cfg(test)]
mod tests;
