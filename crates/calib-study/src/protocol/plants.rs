//! The plants of a protocol that share one study.

use std::path::PathBuf;

use serde::Deserialize;
use toml::Table;

/// A `[[validity.plants]]` entry: the plants that share one study.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Plants {
    /// Path of the study, relative to the folder of the protocol.
    pub(super) study: PathBuf,
    /// Number of plants, each simulated with its own seed (default: one plant, whose name has no number).
    pub(super) repeat: Option<usize>,
    /// Keys that are drawn for each of these plants. They replace the same keys of the common draws.
    #[serde(default)]
    pub(super) draw: Table,
}
