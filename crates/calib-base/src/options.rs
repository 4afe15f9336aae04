//! What whoever runs a step decides. No result depends on it, but for sweeps on a [`Device`].

use std::path::PathBuf;

use calib_knn::IndexKind;
use calib_study::Share;

/// Where networks, representations and agents are trained through libtorch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Device {
    /// The processor.
    Cpu,
    /// The first GPU.
    Cuda,
    /// The first GPU if there is one, else the processor.
    Auto,
}

/// Where large arrays are while a model is built.
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

/// How a model is built; its tables are the same.
#[derive(Clone, Debug, Default)]
pub struct BuildOptions {
    /// Train networks through libtorch, on this device; otherwise natively where that is possible, else [`Device::Auto`].
    pub device: Option<Device>,
    /// Random rows of the tables of each member that are compared with brute force in double precision.
    pub verify: usize,
    /// Search structure, whatever `model.index` says.
    pub index: Option<IndexKind>,
    /// Bytes of memory to stay within; otherwise what the machine, or its container, has free.
    pub memory: Option<u64>,
    /// What is mapped from files.
    pub spill: Spill,
}

/// Whether the logs are read as well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Logs {
    /// Results alone.
    Leave,
    /// Results, and the logs that they were made from.
    Read,
}

/// How well calib chooses, over which plants.
#[derive(Clone, Debug)]
pub struct ValidityOptions {
    /// A protocol, which draws plants and tasks; or study files, each of one plant, or folders of them. At least one.
    pub studies: Vec<PathBuf>,
    /// Overrides of keys of all studies, as `SECTION.KEY=VALUE`.
    pub set: Vec<String>,
    /// The seed to draw plants and tasks from instead of the protocol's.
    pub draw: Option<u64>,
    /// Where the judgement goes; otherwise beside the protocol or the first study.
    pub output: Option<PathBuf>,
    /// Whether what is missing is run.
    pub extent: ValidityExtent,
    /// Which of the plants are run here, where others run the rest; nothing is judged then.
    pub share: Option<Share>,
}

/// How far a judgement of several studies goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ValidityExtent {
    /// Which plants there are and what is left to run.
    Plan,
    /// The sweeps that there are.
    Judge,
    /// Everything that is missing is run first.
    Run,
}

pub use calib_files::ExistingFile;

/// A study to write of a log that nobody has looked at.
#[derive(Clone, Debug)]
pub struct ProposeOptions {
    /// A file, a folder or a glob pattern.
    pub logs: PathBuf,
    /// The study file to write.
    pub study: PathBuf,
    /// How long the proposal and a run of the study may take together on this machine, in seconds.
    pub within: f64,
    /// Sensors to predict; otherwise three that move and are unlike each other.
    pub sensors: Vec<String>,
    /// How far ahead to predict, in seconds; otherwise by the autocorrelation of the sensors.
    pub horizon: Option<f64>,
    /// Keys of `[data]`, as `SECTION.KEY=VALUE`; they hold for the study too.
    pub set: Vec<String>,
    /// What becomes of a study file that is there.
    pub existing: ExistingFile,
}

/// How work is to be divided between processes.
#[derive(Clone, Debug)]
pub struct ClusterPlanOptions {
    /// The plan, a folder.
    pub directory: PathBuf,
    /// Minutes that a shard is to take on one thread.
    pub task_minutes: f64,
    /// Shards that there may be.
    pub max_tasks: usize,
    /// Shards that there are to be, whatever they take.
    pub shards: Option<usize>,
}

/// What is said of a plan.
#[derive(Clone, Copy, Debug)]
pub struct ClusterStatusOptions {
    /// Only the numbers of shards that are not done.
    pub missing: Option<ArrayOf>,
    /// What becomes of what nobody needs any more.
    pub leftovers: Leftovers,
}

/// How numbers of shards are told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArrayOf {
    /// As Slurm's arrays, with ranges.
    Slurm,
    /// A line each.
    Lines,
}

/// States of shards that are done, and what killed processes have left half-written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Leftovers {
    /// They stay.
    Kept,
    /// They are removed.
    Removed,
}

/// How a plan is handed over.
#[derive(Clone, Debug)]
pub struct ClusterSubmitOptions {
    /// To what.
    pub engine: Engine,
    /// What the plan cannot know of the cluster.
    pub config: Option<PathBuf>,
    /// Which shards.
    pub shards: ShardsToSubmit,
    /// Whether anything is.
    pub submission: Submission,
}

/// What runs shards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Engine {
    /// Slurm, by `sbatch`.
    Slurm,
    /// Ray, by a Python program.
    Ray,
    /// Kubernetes; manifests are written, and nothing is applied.
    Kubernetes,
}

/// Which shards are handed over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShardsToSubmit {
    /// All.
    All,
    /// Those that are not done.
    Missing,
}

/// Whether anything is handed over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Submission {
    /// It is.
    Done,
    /// It is said what would be.
    Shown,
}
