//! `cluster.toml`: settings of the cluster that a plan is submitted to. Every key is optional.

use std::{collections::BTreeMap, path::Path};

use calib_base::{Context as _, StepError, ensure};
use calib_files::read_regular;
use serde::{Deserialize, Serialize};

/// The options for a batch system.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct ClusterConfig {
    /// Command that runs calib there.
    pub(crate) calib: String,
    /// Shell lines before it, such as `module load calib`.
    pub(crate) setup: Vec<String>,
    /// Threads per task.
    pub(crate) threads: usize,
    /// Time limit of a task, in minutes. By default twice the predicted time of the longest task, and at
    /// least ten.
    pub(crate) minutes: Option<u64>,
    /// Memory of a task, in megabytes. By default one and a half times the prediction.
    pub(crate) memory_mb: Option<u64>,
    /// Seconds before the time limit at which a task saves its state.
    pub(crate) grace_secs: u64,
    /// Largest number of tasks that run at once.
    pub(crate) at_once: Option<usize>,
    /// How often a task that saved its state is queued again.
    pub(crate) requeues: usize,
    /// Whether the study is evaluated after the merge.
    pub(crate) evaluate: bool,
    /// More options of `sbatch`, such as `partition = "main"`, `account = "abc"`.
    pub(crate) slurm: BTreeMap<String, String>,
    /// The container image, for systems that run one.
    pub(crate) image: String,
    /// The volume that holds the plan, for systems that mount one.
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
    /// Reads the file at `path`, or returns the defaults if there is no path.
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
