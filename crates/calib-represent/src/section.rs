use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{LaplacianConfig, LossConfig, LossForm, OneOrMore, RepresentConfigError};

/// The space in which neighbours are searched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RepresentationKind {
    /// The normalised states.
    #[default]
    None,
    /// A representation that calib trains.
    Laplacian,
    /// A representation from a file.
    Import,
}

/// The `[representation]` section of a study. Each value of a list is tried; several lists make every
/// combination.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RepresentationConfig {
    /// `"none"` (default), `"laplacian"` or `"import"`.
    pub kind: RepresentationKind,
    /// Form of the loss, `"A"` (default) or `"B"`.
    pub form: LossForm,
    /// Weight c of the attraction of successive states.
    pub attraction: f64,
    /// Weight β of the repulsion.
    pub beta: OneOrMore<f64>,
    /// Target ζ of the second moments, which the repulsion drives them to.
    pub zeta: OneOrMore<f64>,
    /// Decay κ of the time between the states of a pair.
    pub kappa: OneOrMore<f64>,
    /// Number of states T of a sub-trajectory.
    pub trajectory: usize,
    /// Number of dimensions of ψ.
    pub dimension: OneOrMore<usize>,
    /// Hidden layers of the encoder.
    pub hidden_layers: usize,
    /// Units of each hidden layer.
    pub hidden_units: OneOrMore<usize>,
    /// Step size of Adam.
    pub learning_rate: OneOrMore<f64>,
    /// Number of pairs in a mini-batch.
    pub batch_size: usize,
    /// Number of updates.
    pub steps: usize,
    /// Only for `"import"`: a `.npy`, `.safetensors` or Parquet file, relative to the folder of the study
    /// file.
    pub path: Option<String>,
    /// Only for safetensors: the name of the tensor (default: the only one).
    pub tensor: Option<String>,
    /// Only for Parquet: join by this column of timestamps (default: by row).
    pub timestamp: Option<String>,
    /// Only for Parquet: the columns that hold ψ (default: all but the timestamps).
    pub columns: Vec<String>,
}

impl Default for RepresentationConfig {
    fn default() -> Self {
        let LaplacianConfig {
            loss: LossConfig { form, attraction, beta, zeta },
            kappa,
            trajectory,
            dimension,
            hidden_layers,
            hidden_units,
            learning_rate,
            batch_size,
            steps,
        } = LaplacianConfig::default();
        Self {
            kind: RepresentationKind::None,
            form,
            attraction,
            beta: beta.into(),
            zeta: zeta.into(),
            kappa: kappa.into(),
            trajectory,
            dimension: dimension.into(),
            hidden_layers,
            hidden_units: hidden_units.into(),
            learning_rate: learning_rate.into(),
            batch_size,
            steps,
            path: None,
            tensor: None,
            timestamp: None,
            columns: Vec::new(),
        }
    }
}

impl RepresentationConfig {
    /// Returns every combination of the lists. The keys are in alphabetical order, and the first varies
    /// slowest.
    pub fn candidates(&self) -> Vec<LaplacianConfig> {
        let mut candidates = Vec::new();
        for &beta in &self.beta.0 {
            for &dimension in &self.dimension.0 {
                for &hidden_units in &self.hidden_units.0 {
                    for &kappa in &self.kappa.0 {
                        for &learning_rate in &self.learning_rate.0 {
                            for &zeta in &self.zeta.0 {
                                let form = self.form;
                                let attraction = self.attraction;
                                candidates.push(LaplacianConfig {
                                    loss: LossConfig { form, attraction, beta, zeta },
                                    kappa,
                                    trajectory: self.trajectory,
                                    dimension,
                                    hidden_layers: self.hidden_layers,
                                    hidden_units,
                                    learning_rate,
                                    batch_size: self.batch_size,
                                    steps: self.steps,
                                });
                            }
                        }
                    }
                }
            }
        }
        candidates
    }

    /// Checks that every value is inside its range.
    ///
    /// # Errors
    /// The first value that is outside its range or occurs twice; an import without a file.
    pub fn check(&self) -> Result<(), RepresentConfigError> {
        let candidates = self.candidates();
        candidates.iter().try_for_each(LaplacianConfig::check)?;
        if let Some(twice) =
            (1..candidates.len()).find(|&at| candidates[..at].contains(&candidates[at]))
        {
            let got = format!("{:?}", candidates[twice]);
            return Err(RepresentConfigError { field: "lists", expected: "each value once", got });
        }
        if self.kind == RepresentationKind::Import && self.path.is_none() {
            return Err(RepresentConfigError {
                field: "path",
                expected: "the file to import, such as \"psi.npy\"",
                got: "nothing".to_owned(),
            });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<RepresentationConfig, String> {
        serde_json::from_str(text).map_err(|error| error.to_string())
    }

    #[test]
    fn lists_make_every_combination() {
        let text =
            r#"{"kind": "laplacian", "learning_rate": [1e-4, 3e-4], "beta": [1, 5], "zeta": 0.1}"#;
        let config = read(text).expect("valid");
        let candidates = config.candidates();
        let pairs: Vec<(f64, f64)> = candidates
            .iter()
            .map(|candidate| (candidate.loss.beta, candidate.learning_rate))
            .collect();
        assert_eq!(pairs, [(1.0, 1e-4), (1.0, 3e-4), (5.0, 1e-4), (5.0, 3e-4)]);
        assert!(
            candidates
                .iter()
                .all(|candidate| candidate.loss.zeta == 0.1 && candidate.dimension == 64)
        );
        let written = serde_json::to_string(&config).expect("JSON");
        assert_eq!(read(&written), Ok(config));
    }

    #[test]
    fn one_value_is_the_defaults_candidate() {
        let config = RepresentationConfig::default();
        assert_eq!(config.candidates(), [LaplacianConfig::default()]);
        config.check().expect("valid");
    }

    fn refused(text: &str) -> String {
        read(text).expect_err("refused")
    }

    fn outside(text: &str) -> RepresentConfigError {
        read(text).expect("typed").check().expect_err("outside")
    }

    #[test]
    fn mistakes_are_told() {
        assert!(refused(r#"{"beta": []}"#).contains("at least one value"));
        assert!(refused(r#"{"beta": "5"}"#).contains("a number or a list of numbers"));
        assert!(refused(r#"{"dimension": [8, 0.5]}"#).contains("0.5"));
        assert!(refused(r#"{"form": "C"}"#).contains("unknown variant `C`"));
        assert_eq!(outside(r#"{"zeta": [0.1, -1]}"#).field, "zeta");
        assert_eq!(outside(r#"{"zeta": [0.1, 0.1]}"#).expected, "each value once");
        assert_eq!(outside(r#"{"kind": "import"}"#).field, "path");
    }
}
