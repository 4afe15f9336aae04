//! The properties of a plant's prediction task.

use calib_agent::ValueFunction;
use calib_study::Study;
use calib_validity::TaskValue;
use schemars::JsonSchema;
use serde::Serialize;

/// The task of a plant: the drawn properties by which results are grouped.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub(crate) struct Task {
    pub(super) optimiser: &'static str,
    pub(super) gamma: f64,
    /// Number of steps of every stream.
    pub(super) steps: usize,
    pub(super) batch_size: usize,
    /// `linear`, or the hidden layers and units, such as `2 x 16`.
    pub(super) agent: String,
}

impl Task {
    /// Returns the task of a study with streams of `steps` steps.
    pub(super) fn of(study: &Study, steps: usize) -> Self {
        let agent = &study.agent;
        Self {
            optimiser: agent.optimiser.name(),
            gamma: agent.gamma,
            steps,
            batch_size: agent.batch_size,
            agent: match agent.value_function {
                _ if agent.is_external() => calib_study::shell_words(agent.command.iter().cloned()),
                ValueFunction::Linear => "linear".to_owned(),
                ValueFunction::Mlp => format!("{} x {}", agent.hidden_layers, agent.hidden_units),
            },
        }
    }

    /// Returns all features except the optimiser, which is stored with each pair.
    pub(super) fn features(&self) -> Vec<(String, TaskValue)> {
        vec![
            number_feature("gamma", self.gamma),
            number_feature("steps", self.steps as f64),
            number_feature("batch size", self.batch_size as f64),
            ("agent".to_owned(), TaskValue::Name(self.agent.clone())),
        ]
    }

    pub(super) fn text(&self) -> String {
        let Self { optimiser, gamma, steps, batch_size, agent } = self;
        format!("{optimiser}, {agent}, gamma {gamma}, {steps} steps, batches of {batch_size}")
    }
}

fn number_feature(name: &str, value: f64) -> (String, TaskValue) {
    (name.to_owned(), TaskValue::Number(value))
}
