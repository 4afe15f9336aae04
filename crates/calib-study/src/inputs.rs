//! Inputs of a result. Every step uses them to decide whether a stored result is up to date.

use std::{collections::BTreeMap, fmt};

use calib_control::Distance;
use calib_dynamics::DynamicsConfig;
use calib_knn::{IndexKind, ModelConfig, WeightsKind};
use calib_model::{ModelFamily, ModelKind};
use calib_represent::RepresentationKind;
use serde::Serialize;
use serde_json::Value;

use crate::{StepKind, Study, overrides};

/// Keys of a study that affect a result, each with its value. Keys that change no byte of the result are left out:
/// the folder of the log (a fingerprint identifies its content), the search structure, and keys of other kinds of model.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Inputs(BTreeMap<String, Value>);

/// A key that affects a result and whose value has changed.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// The key, such as `agent.gamma`.
    pub key: String,
    /// Value that the result was made with; `None` if the study did not have the key.
    pub made: Option<Value>,
    /// Value in the current study.
    pub now: Option<Value>,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { key, made, now } = self;
        write!(f, "{key} = {}, now {}", told(made.as_ref()), told(now.as_ref()))
    }
}

/// Formats the value as JSON, or says that there is no value.
fn told(value: Option<&Value>) -> String {
    value.map_or_else(|| "nothing".to_owned(), ToString::to_string)
}

impl Study {
    /// Returns the keys and values that affect the result of a step.
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

    /// Returns the keys whose change since the study `made` affects the result of `step`.
    pub fn differences(&self, step: StepKind, made: &Self) -> Vec<Difference> {
        self.inputs(step).differences(&made.inputs(step))
    }
}

impl Inputs {
    /// Compares these inputs with those of an earlier result, `made`, in the order of the keys.
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

    /// Adds every key of a section, or of the table at `key`.
    fn add(&mut self, key: &str, section: &impl Serialize) {
        // Serialising cannot fail for a study that was read from a file.
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

    /// Adds the keys that affect a cleaned log. Its path is left out, because a fingerprint identifies its content.
    fn prepared(&mut self, study: &Study) {
        self.add("data", &study.data);
        self.remove(&["data.path"]);
        self.add("preprocess", &study.preprocess);
    }

    /// Adds the keys that select the states used for training.
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

    /// Leaves out the keys that this kind of network does not use.
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
        // The moments affect fine-tuning only. The content of a checkpoint identifies it, not its path.
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
        // `sweep.start` and `rollout.start` mean the same here, so only `rollout.start` stays.
        self.remove(&["sweep.start"]);
        if study.has_model() {
            self.add("rollout", &study.sweep_starts());
            // Only the start states matter. The sweep has its own lengths and numbers of rollouts.
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

    /// Adds the keys that affect a verdict about acting agents. It has its own models.
    fn acted(&mut self, study: &Study) {
        self.prepared(study);
        self.add("deployments", &study.deployments);
        if study.data.train.is_some() {
            self.remove(&["data.train_fraction"]);
        }
        self.add("control", &study.control);
        let model = study.control.as_ref().map(|control| &control.model);
        if model.is_some_and(|model| model.distance == Distance::Laplacian) {
            self.add("representation", &study.representation);
            // This key chooses the representation of a model without actions.
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

    /// Adds the keys that select the held-out period.
    fn held_out(&mut self, study: &Study) {
        self.add("data.held_out", &study.data.held_out);
    }
}

#[cfg(test)]
mod tests;
