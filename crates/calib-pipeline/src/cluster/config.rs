//! `cluster.toml`: what a plan cannot know of the cluster that it is submitted to. Every key may be left out.

use std::{collections::BTreeMap, path::Path};

use calib_base::{Context as _, StepError, ensure};
use calib_files::read_regular;
use serde::{Deserialize, Serialize};

/// What is asked of a batch system.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct ClusterConfig {
    /// Command that runs calib there.
    pub(crate) calib: String,
    /// Lines of shell before it, such as `module load calib`.
    pub(crate) setup: Vec<String>,
    /// Threads of a task.
    pub(crate) threads: usize,
    /// Minutes that a task may take; otherwise twice what the longest one is predicted to, ten at least.
    pub(crate) minutes: Option<u64>,
    /// Megabytes of memory of a task; otherwise what it is predicted to take, and a half more.
    pub(crate) memory_mb: Option<u64>,
    /// Seconds before the limit in which a task keeps its state.
    pub(crate) grace_secs: u64,
    /// Tasks that run at once, at most.
    pub(crate) at_once: Option<usize>,
    /// How often a task that kept its state is put back.
    pub(crate) requeues: usize,
    /// Whether the study is evaluated where all is merged.
    pub(crate) evaluate: bool,
    /// More options of `sbatch`, such as `partition = "main"`, `account = "abc"`.
    pub(crate) slurm: BTreeMap<String, String>,
    /// Of the image, where a system runs such.
    pub(crate) image: String,
    /// Of a volume on which the plan lies, where a system mounts such.
    pub(crate) volume: String,
}

impl Default for ClusterConfig {
    fn default() -> Self {
        Self {
            calib: "calib".to_owned(),
            setup: Vec::new(),
            threads: 1,
            minutes: None,
            memory_mb: None,
            grace_secs: 120,
            at_once: None,
            requeues: 9,
            evaluate: true,
            slurm: BTreeMap::new(),
            image: "calib:latest".to_owned(),
            volume: "calib".to_owned(),
        }
    }
}

impl ClusterConfig {
    /// The file at `path`, or nothing but defaults.
    pub(crate) fn read(path: Option<&Path>) -> Result<Self, StepError> {
        let Some(path) = path else { return Ok(Self::default()) };
        let text = String::from_utf8(read_regular(path)?)
            .with_context(|| format!("{} is no text", path.display()))?;
        let config: Self = toml::from_str(&text).with_context(|| path.display().to_string())?;
        ensure!(config.threads > 0, "{}: threads must be at least 1", path.display());
        let texts = config.slurm.iter().flat_map(|(key, value)| [key, value]);
        let texts = texts.chain([&config.image, &config.volume]);
        for text in texts {
            ensure!(
                !text.chars().any(char::is_control),
                "{}: {text:?} has a line break or another control character",
                path.display()
            );
        }
        Ok(config)
    }
}
