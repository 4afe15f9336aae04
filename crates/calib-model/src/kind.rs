use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Kinds of calibration models: `model.kind` of a study.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ModelKind {
    /// Nearest neighbours: an ensemble whose rollouts never leave the data.
    #[default]
    Knn,
    /// A feed-forward network that predicts the next state.
    Nn,
    /// A recurrent network that predicts the next state.
    Gru,
    /// A network of the user, exported from PyTorch.
    Torchscript,
    /// No model: only log replay decides.
    None,
}

impl ModelKind {
    /// Returns the family of this kind of model.
    pub fn family(self) -> ModelFamily {
        match self {
            Self::Knn => ModelFamily::Neighbors,
            Self::Nn | Self::Gru | Self::Torchscript => ModelFamily::Network,
            Self::None => ModelFamily::None,
        }
    }

    /// Returns the label in figures and tables.
    pub fn label(self) -> &'static str {
        match self {
            Self::Knn => "kNN",
            Self::Nn => "NN",
            Self::Gru => "GRU",
            Self::Torchscript => "TorchScript model",
            // The selection method that replaces the model.
            Self::None => "log replay",
        }
    }
}

/// The family of a calibration model, which decides how many ensemble members it has and which keys of a study
/// it uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModelFamily {
    /// Tables of neighbours: an ensemble over blocks of the log, searched in the states or a representation of
    /// them.
    Neighbors,
    /// One network, to which `[dynamics]` applies.
    Network,
    /// No model.
    None,
}
