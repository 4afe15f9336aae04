//! Options of the caller of a step. No result depends on them, except for sweeps on a [`Device`].

use std::path::PathBuf;

use calib_knn::IndexKind;
use calib_study::Share;

/// The device on which libtorch trains networks, representations and agents.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Device {
    /// The processor.
    Cpu,
    /// The first GPU.
    Cuda,
    /// The first GPU if there is one, otherwise the processor.
    Auto,
}

/// The place of large arrays while a model is built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Spill {
    /// In files only if they do not fit in memory.
    #[default]
    Auto,
    /// Always in memory.
    Never,
    /// Always in files.
    Always,
}

/// Options of building a model. They do not change its tables.
#[derive(Clone, Debug, Default)]
pub struct BuildOptions {
    /// Trains networks through libtorch, on this device. Otherwise natively.
    pub device: Option<Device>,
    /// Number of random rows of each member's tables that are compared with brute force in double precision.
    pub verify: usize,
    /// Search structure, which overrides `model.index`.
    pub index: Option<IndexKind>,
    /// Memory limit in bytes. The default is the free memory of the machine, or of its container.
    pub memory: Option<u64>,
    /// Whether large arrays are mapped from files.
    pub spill: Spill,
}

/// Whether the logs are read as well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Logs {
    /// Reads only results.
    Leave,
    /// Reads results, and the logs that they were made from.
    Read,
}

/// Options of a validity study over many plants.
#[derive(Clone, Debug)]
pub struct ValidityOptions {
    /// A protocol, which draws plants and tasks; or study files, each of one plant, or folders of them. At least one.
    pub studies: Vec<PathBuf>,
    /// Overrides of keys of all studies, as `SECTION.KEY=VALUE`.
    pub set: Vec<String>,
    /// The seed for drawing plants and tasks, which overrides the protocol's.
    pub draw: Option<u64>,
    /// The place of the judgement. The default is beside the protocol or the first study.
    pub output: Option<PathBuf>,
    /// Whether missing sweeps are run.
    pub extent: ValidityExtent,
    /// The share of the plants to run here, if other machines run the rest. There is no judgement then.
    pub share: Option<Share>,
}

/// The extent of a judgement of several studies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ValidityExtent {
    /// Lists the plants and the remaining work.
    Plan,
    /// Judges the existing sweeps.
    Judge,
    /// Runs everything that is missing first.
    Run,
}

pub use calib_files::ExistingFile;

/// Options for proposing a study of an unknown log.
#[derive(Clone, Debug)]
pub struct ProposeOptions {
    /// A file, a folder or a glob pattern.
    pub logs: PathBuf,
    /// The study file to write.
    pub study: PathBuf,
    /// Time limit for the proposal and a run of the study together on this machine, in seconds.
    pub within: f64,
    /// Sensors to predict. The default is three that vary and differ from each other.
    pub sensors: Vec<String>,
    /// Prediction horizon, in seconds. The default follows from the autocorrelation of the sensors.
    pub horizon: Option<f64>,
    /// Keys of `[data]`, as `SECTION.KEY=VALUE`. They apply to the study too.
    pub set: Vec<String>,
    /// Whether an existing study file is replaced.
    pub existing: ExistingFile,
}

/// Options for dividing work between processes.
#[derive(Clone, Debug)]
pub struct ClusterPlanOptions {
    /// The folder of the plan.
    pub directory: PathBuf,
    /// Target time of a shard on one thread, in minutes.
    pub task_minutes: f64,
    /// Maximum number of shards.
    pub max_tasks: usize,
    /// Exact number of shards, whatever time they take.
    pub shards: Option<usize>,
}

/// Options for reporting on a plan.
#[derive(Clone, Copy, Debug)]
pub struct ClusterStatusOptions {
    /// Prints only the numbers of shards that are not done.
    pub missing: Option<ArrayOf>,
    /// Whether files that are no longer needed are removed.
    pub leftovers: Leftovers,
}

/// The format of the numbers of shards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArrayOf {
    /// As Slurm's arrays, with ranges.
    Slurm,
    /// One line each.
    Lines,
}

/// Files of finished shards, and half-written files of killed processes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Leftovers {
    /// Kept.
    Kept,
    /// Removed.
    Removed,
}

/// Options for submitting a plan.
#[derive(Clone, Debug)]
pub struct ClusterSubmitOptions {
    /// The system to submit to.
    pub engine: Engine,
    /// A file with settings of the cluster that the plan does not contain.
    pub config: Option<PathBuf>,
    /// The shards to submit.
    pub shards: ShardsToSubmit,
    /// Whether shards are submitted.
    pub submission: Submission,
}

/// A system that runs shards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Engine {
    /// Slurm, by `sbatch`.
    Slurm,
    /// Ray, by a Python program.
    Ray,
    /// Kubernetes. Manifests are written, but not applied.
    Kubernetes,
}

/// The shards to submit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShardsToSubmit {
    /// All shards.
    All,
    /// Shards that are not done.
    Missing,
}

/// Whether shards are submitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Submission {
    /// They are submitted.
    Done,
    /// The submission is only printed.
    Shown,
}
