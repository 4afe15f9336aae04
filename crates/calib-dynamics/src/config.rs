use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{DynamicsError, Noise};

/// The `[dynamics]` section of a study: parametric models, of any kind but `"knn"`.
///
/// Defaults are those of the paper (its tables of NN and GRU hyperparameters). Where the paper gives none, they are our choice.
///
/// | key | default | meaning |
/// |---|---|---|
/// | `hidden_layers` | 2 | hidden layers of the network, or layers of the GRU |
/// | `hidden_units` | 512 | units of each layer |
/// | `learning_rate` | 1e-3 | step size of Adam |
/// | `batch_size` | 256 | transitions, or sequences, per update |
/// | `epochs` | 100 | passes over the training part |
/// | `sequence_length` | 20 | transitions per sequence, for the GRU |
/// | `sequence_stride` | 1 | transitions between the starts of successive sequences (our choice: every window) |
/// | `validation_fraction` | 0.1 | fraction of the training range, at its end, that is used only for validation (our choice) |
/// | `keep` | `"best"` | the epoch whose weights are kept: the one with the lowest validation loss, or the last (our choice) |
/// | `noise` | `"none"` | noise that rollouts add to predictions: none (the paper), or recorded residuals |
/// | `path` | none | a `TorchScript` file, for `"torchscript"` |
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DynamicsConfig {
    /// Hidden layers of the network, or layers of the GRU.
    pub hidden_layers: usize,
    /// Units of each layer.
    pub hidden_units: usize,
    /// Step size of Adam.
    pub learning_rate: f64,
    /// Transitions, or sequences, per update.
    pub batch_size: usize,
    /// Passes over the training part.
    pub epochs: usize,
    /// Transitions per sequence.
    pub sequence_length: usize,
    /// Transitions between the starts of successive sequences.
    pub sequence_stride: usize,
    /// Fraction of the training range, at its end, that is used only for validation.
    pub validation_fraction: f64,
    /// The epoch whose weights are kept.
    pub keep: Keep,
    /// The noise that rollouts add to predictions: `"none"` (the paper), `"residual"` or `"block"`. Omitted where it is the default.
    #[serde(skip_serializing_if = "DynamicsConfig::is_without_noise")]
    #[schemars(extend("default" = "none"))]
    pub noise: Noise,
    /// A `TorchScript` file.
    pub path: Option<PathBuf>,
}

/// The epoch whose weights are kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Keep {
    /// The epoch with the lowest validation loss; the first of equal ones.
    #[default]
    Best,
    /// The last epoch.
    Last,
}

impl Default for DynamicsConfig {
    fn default() -> Self {
        Self {
            hidden_layers: 2,
            hidden_units: 512,
            learning_rate: 1e-3,
            batch_size: 256,
            epochs: 100,
            sequence_length: 20,
            sequence_stride: 1,
            validation_fraction: 0.1,
            keep: Keep::Best,
            noise: Noise::None,
            path: None,
        }
    }
}

impl DynamicsConfig {
    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands fields over so")]
    fn is_without_noise(noise: &Noise) -> bool {
        *noise == Noise::None
    }

    /// Checks what can be checked before data is read. The upper limits catch typing errors.
    ///
    /// # Errors
    /// If a value is outside its range.
    pub fn check(&self) -> Result<(), DynamicsError> {
        let counts = [
            ("hidden_layers", self.hidden_layers, 16),
            ("hidden_units", self.hidden_units, 16_384),
            ("batch_size", self.batch_size, 1 << 20),
            ("epochs", self.epochs, 1_000_000),
            ("sequence_length", self.sequence_length, 10_000),
            ("sequence_stride", self.sequence_stride, 1_000_000),
        ];
        for (key, got, most) in counts {
            if !(1..=most).contains(&got) {
                return Err(DynamicsError::Config {
                    key,
                    expected: format!("a whole number from 1 to {most}"),
                    got: got.to_string(),
                });
            }
        }
        if !(1e-45..=1e38).contains(&self.learning_rate) {
            let expected =
                "a positive number, from 1e-45 to 1e38 (weights are in single precision)";
            return Err(refused_number("learning_rate", expected, self.learning_rate));
        }
        if !(self.validation_fraction > 0.0 && self.validation_fraction < 1.0) {
            let expected = "a number between 0 and 1";
            return Err(refused_number("validation_fraction", expected, self.validation_fraction));
        }
        Ok(())
    }
}

/// Returns the error that `key` is not as expected.
fn refused_number(key: &'static str, expected: &str, got: f64) -> DynamicsError {
    DynamicsError::Config { key, expected: expected.to_owned(), got: format!("{got:?}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_section_is_the_documented_default() {
        let config: DynamicsConfig = toml::from_str("").expect("all keys have defaults");
        assert_eq!(config, DynamicsConfig::default());
        config.check().expect("defaults are valid");
    }

    /// Returns the error message for a section.
    fn refusal(text: &str) -> String {
        let config: DynamicsConfig = toml::from_str(text).expect("readable");
        config.check().expect_err(text).to_string()
    }

    #[test]
    fn slips_are_named() {
        assert!(refusal("epochs = 0").contains("epochs"), "{}", refusal("epochs = 0"));
        assert!(refusal("learning_rate = -1.0").contains("positive"));
        assert!(refusal("validation_fraction = 1.0").contains("between 0 and 1"));
        assert!(toml::from_str::<DynamicsConfig>("hidden = 3").is_err());
    }
}
