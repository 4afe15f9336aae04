//! Arguments of the commands that build models and representations.

use calib_knn::IndexKind;
use calib_pipeline::MemorySize;
use clap::{Args, ValueEnum};

use super::{heading::OUTPUT, status::Address, study::StudyArgs};

/// Where networks are trained.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Device {
    /// The processor
    Cpu,
    /// The first GPU
    Cuda,
    /// The first GPU if there is one, else the processor
    Auto,
}

#[derive(Debug, Args)]
pub(crate) struct RepresentArgs {
    #[command(flatten)]
    pub(crate) study: StudyArgs,
    /// Train only this share of the grid, where others train the rest, such as 0/8 or auto/8; then run it without
    #[arg(long, value_name = "I/N")]
    pub(crate) share: Option<String>,
    /// Train through libtorch, on this device (default: natively)
    #[arg(long, value_name = "DEVICE", value_enum)]
    pub(crate) device: Option<Device>,
}

#[derive(Debug, Args)]
pub(crate) struct DeviceArgs {
    #[command(flatten)]
    pub(crate) study: StudyArgs,
    /// Train through libtorch on this device, agents of many runs side by side (default: natively); such results are kept apart
    #[arg(long, value_name = "DEVICE", value_enum)]
    pub(crate) device: Option<Device>,
}

#[derive(Debug, Args)]
pub(crate) struct RunArgs {
    #[command(flatten)]
    pub(crate) study: DeviceArgs,
    /// Print all reasons of the verdict, as in the report
    #[arg(long)]
    pub(crate) why: bool,
    /// Show a page with progress, time left and the ranking so far, at this address of this machine, such as 127.0.0.1:8080 or 8080, as long as the command runs
    #[arg(long, value_name = "ADDRESS", help_heading = OUTPUT)]
    pub(crate) serve: Option<Address>,
}

#[derive(Debug, Args)]
pub(crate) struct PretrainArgs {
    #[command(flatten)]
    pub(crate) study: StudyArgs,
    /// Train only this share of the sensors, where others train the rest, such as 0/8 or auto/8; then run it without
    #[arg(long, value_name = "I/N")]
    pub(crate) share: Option<String>,
}

#[derive(Debug, Args)]
pub(crate) struct BuildModelArgs {
    #[command(flatten)]
    pub(crate) study: StudyArgs,
    #[command(flatten)]
    pub(crate) options: BuildOptions,
}

/// How a model is built; its tables are the same.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "How it is built")]
pub(crate) struct BuildOptions {
    /// Train networks through libtorch, on this device (default: natively)
    #[arg(long, value_name = "DEVICE", value_enum)]
    pub(crate) device: Option<Device>,
    /// Check this many random rows of the tables against brute force in double precision
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) verify: usize,
    /// Search structure, whatever `model.index` says; the tables are the same
    #[arg(long, value_name = "KIND", value_enum)]
    pub(crate) index: Option<Index>,
    /// Memory to stay within, such as 16GiB (default: what the machine, or its container, has free)
    #[arg(long, value_name = "SIZE")]
    pub(crate) memory: Option<MemorySize>,
    /// Where states, images and tables are kept while the model is built
    #[arg(long, value_enum, default_value_t = Spill::Auto)]
    pub(crate) spill: Spill,
}

/// Search structures, as in `model.index`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Index {
    /// Whichever suits the data
    Auto,
    /// A k-d tree, up to 8 columns
    #[value(name = "kd_tree", aliases = ["kdtree", "kd-tree"])]
    KdTree,
    /// Leaves and boxes, for data with structure
    Join,
    /// Every pair, for data without structure
    Scan,
}

/// Where large arrays are while a model is built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum Spill {
    /// In files only if they do not fit in memory
    #[default]
    Auto,
    /// Always in memory
    Never,
    /// Always in files
    Always,
}

impl From<Device> for calib_pipeline::Device {
    fn from(device: Device) -> Self {
        match device {
            Device::Cpu => Self::Cpu,
            Device::Cuda => Self::Cuda,
            Device::Auto => Self::Auto,
        }
    }
}

impl From<Index> for IndexKind {
    fn from(index: Index) -> Self {
        match index {
            Index::Auto => Self::Auto,
            Index::KdTree => Self::KdTree,
            Index::Join => Self::Join,
            Index::Scan => Self::Scan,
        }
    }
}

impl From<Spill> for calib_pipeline::Spill {
    fn from(spill: Spill) -> Self {
        match spill {
            Spill::Auto => Self::Auto,
            Spill::Never => Self::Never,
            Spill::Always => Self::Always,
        }
    }
}

impl From<BuildOptions> for calib_pipeline::BuildOptions {
    fn from(options: BuildOptions) -> Self {
        let BuildOptions { device, verify, index, memory, spill } = options;
        Self {
            device: device.map(Into::into),
            verify,
            index: index.map(Into::into),
            memory: memory.map(|size| size.0),
            spill: spill.into(),
        }
    }
}
