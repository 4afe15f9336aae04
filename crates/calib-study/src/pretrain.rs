use std::path::PathBuf;

use calib_agent::{AgentConfig, PretrainSettings};
use calib_data::TimeRange;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::error::{Problem, require};

/// The `[pretrain]` section: agents that learn from the log before deployment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PretrainConfig {
    /// Maximum number of passes over the training transitions (default 0: no pre-training).
    pub epochs: usize,
    /// Step size of pre-training (default 1e-5, as in the paper). Fine-tuning uses `agent.learning_rate`.
    pub learning_rate: f64,
    /// Fraction of the transitions, the last in time, that is held back for validation (default 0.1, as in the
    /// paper).
    pub validation_fraction: f64,
    /// Stop after this many epochs without a better validation error and keep the best epoch (default 0: never
    /// stop).
    pub patience: usize,
    /// How fine-tuning treats the moments of the optimiser.
    pub moments: MomentsRule,
    /// The first part of the training range's time span, for pre-training; the calibration model uses the rest
    /// (default 0.5, as in the paper).
    pub fraction: f64,
    /// Alternative to `fraction`: the period for pre-training. `model.period` is then the period of the model.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub period: Option<TimeRange>,
    /// Take the agents from this `pretrain` directory of another study instead of pre-training them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub checkpoint: Option<PathBuf>,
}

/// How fine-tuning treats Adam's moments.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MomentsRule {
    /// They start at zero, as with a new optimiser.
    #[default]
    Reset,
    /// They continue from the end of pre-training.
    Keep,
}

impl Default for PretrainConfig {
    fn default() -> Self {
        Self {
            epochs: 0,
            learning_rate: 1e-5,
            validation_fraction: 0.1,
            patience: 0,
            moments: MomentsRule::Reset,
            fraction: 0.5,
            period: None,
            checkpoint: None,
        }
    }
}

impl PretrainConfig {
    /// Whether agents are pre-trained at all.
    pub fn is_on(&self) -> bool {
        self.epochs > 0 || self.checkpoint.is_some()
    }

    /// Returns the settings for epochs, early stopping and validation.
    pub fn settings(&self) -> PretrainSettings {
        PretrainSettings {
            epochs: self.epochs,
            patience: self.patience,
            validation_fraction: self.validation_fraction,
        }
    }

    /// Returns the agent of `[agent]` with the step size of pre-training.
    pub fn agent(&self, agent: &AgentConfig) -> AgentConfig {
        AgentConfig { learning_rate: self.learning_rate, ..agent.clone() }
    }

    /// Checks every value by itself.
    pub(crate) fn check(&self) -> Result<(), Problem> {
        require!(
            (1e-45..=1e38).contains(&self.learning_rate),
            "pretrain.learning_rate must be a positive number from 1e-45 to 1e38, got {:?}",
            self.learning_rate
        );
        require!(
            is_proper(self.validation_fraction),
            "pretrain.validation_fraction must be above 0 and below 1, got {:?}",
            self.validation_fraction
        );
        require!(
            is_proper(self.fraction),
            "pretrain.fraction must be above 0 and below 1, got {:?}",
            self.fraction
        );
        require!(
            self.checkpoint.is_none() || self.epochs == 0,
            "pretrain.checkpoint takes agents from elsewhere and pretrain.epochs = {} trains them here; \
             give one of them",
            self.epochs
        );
        Ok(())
    }
}

/// Whether the fraction leaves something on both sides.
fn is_proper(fraction: f64) -> bool {
    fraction > 0.0 && fraction < 1.0
}
