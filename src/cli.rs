//! The command line, and nothing else: what may be typed and what it means.

mod cluster;

use std::{
    path::{Path, PathBuf},
    sync::LazyLock,
};

use calib_control::{Quality, TaskKind};
use calib_dtw::{LocalDistance, StepPattern, Window};
use calib_knn::IndexKind;
use calib_pipeline::{
    Answer, MemorySize, ProposeOptions, STEP_PATTERNS, Standing, ValidityExtent, ValidityOptions,
};
use calib_study::{Existing, Job, Policy, Request, Study, StudyError, Writes};
use clap::{Args, Parser, Subcommand, ValueEnum, builder::ArgPredicate};
use clap_complete::Shell;
pub(crate) use cluster::{ClusterCommand, ClusterEngine, MissingAs};

/// Headings of options.
const OUTPUT: &str = "What is shown";
const STUDY: &str = "Which study";
const RESULTS: &str = "Results";

/// The version, the commit where whoever built it said so (`CALIB_COMMIT`), and what it was built with.
fn version() -> &'static str {
    static VERSION: LazyLock<String> = LazyLock::new(|| {
        let commit = option_env!("CALIB_COMMIT").map(|commit| format!("commit {commit}"));
        let torch = if cfg!(feature = "torch") { "with libtorch" } else { "without libtorch" };
        let built = commit.into_iter().chain([torch.to_owned()]).collect::<Vec<_>>().join(", ");
        format!("{} ({built})", env!("CARGO_PKG_VERSION"))
    });
    VERSION.as_str()
}

/// Choose the hyperparameters of an online learner from a plant's logs, before it is deployed.
#[derive(Debug, Parser)]
#[command(name = "calib", version = version(), propagate_version = true, max_term_width = 100)]
#[command(
    after_help = "Start with `calib quickstart`: it simulates a plant, runs the whole chain and ends with a verdict."
)]
pub struct Cli {
    #[command(flatten)]
    pub(crate) global: GlobalArgs,
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Clone, Debug, Args)]
pub(crate) struct GlobalArgs {
    /// Print results and errors only
    #[arg(short, long, global = true, help_heading = OUTPUT)]
    pub(crate) quiet: bool,
    /// Say with every line how long the command has been running
    #[arg(short, long, global = true, conflicts_with = "quiet", help_heading = OUTPUT)]
    pub(crate) verbose: bool,
    /// Append all that is said, and results, to a file, with times: what `--quiet` hides as well
    #[arg(long, global = true, value_name = "FILE", help_heading = OUTPUT)]
    pub(crate) log: Option<PathBuf>,
    /// When to use colour; `NO_COLOR` is obeyed
    #[arg(long, global = true, value_enum, default_value_t = ColorChoice::Auto, help_heading = OUTPUT)]
    pub(crate) color: ColorChoice,
    /// Threads to work with (default: one per core); results do not depend on it
    #[arg(long, global = true, value_name = "N")]
    pub(crate) threads: Option<usize>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ColorChoice {
    Auto,
    Always,
    Never,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Simulate a small plant, run the whole chain, and print the verdict
    Quickstart(QuickstartArgs),
    /// Write Parquet logs of a simulated membrane-filtration pilot plant
    Simulate(Box<SimulateArgs>),
    /// Look at a log, and write a study of it with a reason for every value
    Init(InitArgs),
    /// Show what is in a log and what preprocessing would keep
    Inspect(InspectArgs),
    /// Write logs of any form (CSV, long tables, a file a tag) once as one wide Parquet file
    Import(ImportArgs),
    /// Run a study from its log to the verdict: every step that it needs, as far as it is not done
    Run(StudyArgs),
    /// Train or import representations of the states, score them, and choose one
    Represent(RepresentArgs),
    /// Build the ensemble of nearest-neighbour calibration models
    BuildModel(BuildModelArgs),
    /// Roll the model out and compare with the recorded trajectory
    Rollout(StudyArgs),
    /// Pre-train one agent a sensor on a part of the log, for `sweep` to start from
    Pretrain(StudyArgs),
    /// Train agents for every value of the grid in the model, Online and on the replayed log
    Sweep(StudyArgs),
    /// Choose a value, say how well the choice agrees with Online, and write the report
    #[command(mut_arg("study", |arg| {
        arg.required(false).required_unless_present("runs").default_value_if("runs", ArgPredicate::IsPresent, NO_STUDY)
    }))]
    Evaluate(EvaluateArgs),
    /// For agents that act: read a log of decisions, let every candidate act in its model, and say which to deploy
    Control(StudyArgs),
    /// Read results, and name what is not what was written
    Check(CheckArgs),
    /// Divide a study's sweeps between processes, on one machine or many
    Cluster {
        #[command(subcommand)]
        command: ClusterCommand,
    },
    /// Judge how well calib chooses, over several studies with held-out data
    Validity(ValidityArgs),
    /// Dynamic time warping distance between two series
    Dtw(DtwArgs),
    /// Say what a key of a study means, such as agent.gamma; without one, which sections there are
    Explain {
        /// A key or a section: agent.gamma, sweep
        key: Option<String>,
        /// Print its part of the schema as JSON
        #[arg(long, help_heading = OUTPUT)]
        json: bool,
    },
    /// Print a completion script for a shell
    Completions {
        /// The shell
        shell: Shell,
    },
    /// Write man pages
    Man {
        /// The directory to write to
        directory: PathBuf,
    },
}

impl Command {
    /// Whom the result is for.
    pub(crate) fn answer(&self) -> Answer {
        let json = match self {
            Self::Run(args)
            | Self::Rollout(args)
            | Self::Pretrain(args)
            | Self::Sweep(args)
            | Self::Control(args)
            | Self::Evaluate(EvaluateArgs { study: args, .. }) => args.json,
            Self::Represent(args) => args.study.json,
            Self::BuildModel(args) => args.study.json,
            Self::Quickstart(args) => args.json,
            Self::Simulate(args) => args.json,
            Self::Init(args) => args.json,
            Self::Inspect(args) => args.json,
            Self::Import(args) => args.json,
            Self::Check(args) => args.json,
            Self::Validity(args) => args.json,
            Self::Dtw(args) => args.json,
            Self::Explain { json, .. }
            | Self::Cluster { command: ClusterCommand::Status { json, .. } } => *json,
            Self::Cluster { command: ClusterCommand::Plan { study, .. } } => study.json,
            Self::Cluster { .. } | Self::Completions { .. } | Self::Man { .. } => false,
        };
        if json { Answer::ForMachines } else { Answer::ForPeople }
    }
}

/// What `check` takes.
#[derive(Clone, Debug, Args)]
pub(crate) struct CheckArgs {
    /// A folder of results, such as study-results
    pub(crate) directory: PathBuf,
    /// Read also the logs that the results were made from
    #[arg(long)]
    pub(crate) read_data: bool,
    /// Print the result as JSON
    #[arg(long, help_heading = OUTPUT)]
    pub(crate) json: bool,
}

/// What every command on a study takes.
#[derive(Clone, Debug, Args)]
pub(crate) struct StudyArgs {
    /// The study file (TOML)
    pub(crate) study: PathBuf,
    /// Override a key of the study; may be given several times
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE", help_heading = STUDY)]
    pub(crate) set: Vec<String>,
    /// The study as this one of its [profiles] has it
    #[arg(long, value_name = "NAME", help_heading = STUDY)]
    pub(crate) profile: Option<String>,
    /// Only this one of the study's [models] (default: one after the other)
    #[arg(long, value_name = "NAME", help_heading = STUDY)]
    pub(crate) model: Option<String>,
    /// Only this one of the study's [deployments] (default: one after the other)
    #[arg(long, value_name = "NAME", help_heading = STUDY)]
    pub(crate) deployment: Option<String>,
    /// Where results go (default: beside the study file)
    #[arg(long, value_name = "DIR", help_heading = RESULTS)]
    pub(crate) output: Option<PathBuf>,
    /// Redo everything, also what is up to date
    #[arg(long, help_heading = RESULTS)]
    pub(crate) force: bool,
    /// Say what would be done, and stop
    #[arg(long, help_heading = RESULTS)]
    pub(crate) dry_run: bool,
    /// Print the result as JSON
    #[arg(long, help_heading = OUTPUT)]
    pub(crate) json: bool,
}

impl StudyArgs {
    /// The study, read and resolved; the command looks at the file never again.
    ///
    /// # Errors
    /// As [`Job::resolve`].
    pub(crate) fn job(self) -> Result<Job, StudyError> {
        let Self { study, set, profile, model, deployment, output, force, dry_run, json: _ } = self;
        let existing = if force { Existing::Redo } else { Existing::Keep };
        let writes = if dry_run { Writes::Nothing } else { Writes::Missing };
        let policy = Policy { existing, writes };
        Job::resolve(Request { study, set, profile, model, deployment, output, policy })
    }
}

/// In the place of a study where there is none.
const NO_STUDY: &str = "-";

#[derive(Debug, Args)]
pub(crate) struct EvaluateArgs {
    #[command(flatten)]
    pub(crate) study: StudyArgs,
    /// Judge the runs of this table (Parquet), which something else made, instead of a sweep; a study is only looked at for how to judge
    #[arg(long, value_name = "FILE")]
    pub(crate) runs: Option<PathBuf>,
}

impl EvaluateArgs {
    /// What judges the runs of a table: the study, or without one the defaults with what is set.
    ///
    /// # Errors
    /// As [`Job::resolve`].
    pub(crate) fn judging(study: StudyArgs) -> Result<(Study, Option<PathBuf>), StudyError> {
        let output = study.output.clone();
        if study.study == Path::new(NO_STUDY) {
            return Ok((calib_study::of_data(Path::new(NO_STUDY), &study.set)?, output));
        }
        Ok((study.job()?.study().clone(), output))
    }
}

#[derive(Debug, Args)]
pub(crate) struct ValidityArgs {
    /// A protocol, which draws plants and tasks; or study files, each of one plant, or folders of them
    #[arg(required = true, value_name = "PROTOCOL|STUDY|FOLDER")]
    pub(crate) studies: Vec<PathBuf>,
    /// Override a key of all studies; may be given several times
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub(crate) set: Vec<String>,
    /// Draw plants and tasks from this seed instead of the protocol's, in a folder of their own
    #[arg(long, value_name = "N")]
    pub(crate) draw: Option<u64>,
    /// Where the judgement goes, and what a protocol draws (default: validity-results beside the protocol or the first study)
    #[arg(long, value_name = "DIR")]
    pub(crate) output: Option<PathBuf>,
    /// How often plants are drawn again for each interval
    #[arg(long, value_name = "N", default_value_t = 10_000)]
    pub(crate) resamples: usize,
    /// Root of these draws
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    /// Judge the sweeps that there are; run nothing
    #[arg(long)]
    pub(crate) judge_only: bool,
    /// Say which plants there are and what is left to run, and stop
    #[arg(long)]
    pub(crate) dry_run: bool,
    /// Print the judgement as JSON
    #[arg(long, help_heading = OUTPUT)]
    pub(crate) json: bool,
}

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
    /// Train through libtorch, on this device (default: natively)
    #[arg(long, value_name = "DEVICE", value_enum)]
    pub(crate) device: Option<Device>,
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
    /// Train networks through libtorch, on this device (default: natively where that is possible, else auto)
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
    /// Whether states, images and tables are mapped from files while the model is built
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

#[derive(Debug, Args)]
pub(crate) struct QuickstartArgs {
    /// Where the data, the study file and the report go
    #[arg(default_value = "calib-quickstart")]
    pub(crate) directory: PathBuf,
    /// Root of all randomness
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    /// Print the verdict as JSON
    #[arg(long, help_heading = OUTPUT)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct SimulateArgs {
    /// Where the day files go; or a study file, whose [simulate] says what to write to its data.path
    #[arg(value_name = "DIRECTORY or STUDY")]
    pub(crate) target: PathBuf,
    #[command(flatten)]
    pub(crate) plant: PlantArgs,
    #[command(flatten)]
    pub(crate) task: TaskArgs,
    /// Override a key of the study, such as `simulate.days=2`; may be given several times
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub(crate) set: Vec<String>,
    /// The study as this one of its [profiles] has it
    #[arg(long, value_name = "NAME")]
    pub(crate) profile: Option<String>,
    /// Write all days again, also those that exist
    #[arg(long)]
    pub(crate) force: bool,
    /// Print what was written as JSON
    #[arg(long, help_heading = OUTPUT)]
    pub(crate) json: bool,
}

/// A task that somebody acts in, instead of the plant: a log of decisions.
#[derive(Clone, Debug, Default, PartialEq, Eq, Args)]
#[command(next_help_heading = "A task that somebody acts in, instead of the plant")]
pub(crate) struct TaskArgs {
    /// Write a log of actions and rewards in this task, and a study of it for `calib control`
    #[arg(long, value_name = "TASK", value_enum)]
    pub(crate) task: Option<Task>,
    /// Whose actions are recorded [default: near-optimal]
    #[arg(long, value_name = "POLICY", value_enum, requires = "task")]
    pub(crate) policy: Option<Policies>,
    /// Steps to record [default: 5000]
    #[arg(long, value_name = "N", requires = "task")]
    pub(crate) transitions: Option<usize>,
}

/// Tasks whose truth is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Task {
    /// Swing a two-link pendulum up
    Acrobot,
    /// Balance a pole on a cart
    CartPole,
    /// Operate a membrane plant, by one of eight recipes every half hour
    Membrane,
    /// Swing a pendulum up and hold it there
    Pendulum,
    /// Cross a square around two puddles
    PuddleWorld,
}

/// Whose actions are recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Policies {
    /// An agent that has learnt the task
    NearOptimal,
    /// The same, but three actions of ten are random
    Medium,
    /// Every action alike
    Random,
    /// The fixed rule of those who operate it (membrane)
    Rule,
    /// The same, but two actions of ten are random
    Perturbed,
}

/// The plant, where no study describes it.
#[derive(Clone, Debug, Default, PartialEq, Args)]
#[command(next_help_heading = "The plant")]
pub(crate) struct PlantArgs {
    /// Days to simulate; the last may be a part of one [default: 7]
    #[arg(long)]
    pub(crate) days: Option<f64>,
    /// Sensor channels (at least 3) [default: 480]
    #[arg(long)]
    pub(crate) channels: Option<usize>,
    /// Seconds between samples [default: 1]
    #[arg(long, value_name = "SECS")]
    pub(crate) period: Option<f64>,
    /// First day [default: 2022-11-01]
    #[arg(long, value_name = "DATE")]
    pub(crate) start: Option<String>,
    /// Root of all randomness [default: 0]
    #[arg(long)]
    pub(crate) seed: Option<u64>,
    /// Factor on the slow drift of the instruments [default: 1]
    #[arg(long, value_name = "FACTOR")]
    pub(crate) drift: Option<f64>,
    /// Factor on the white noise of the instruments [default: 1]
    #[arg(long, value_name = "FACTOR")]
    pub(crate) noise: Option<f64>,
    /// Mean rate of turbidity bursts [default: 6]
    #[arg(long, value_name = "RATE")]
    pub(crate) storms_per_day: Option<f64>,
    /// Expected share of missing values of a healthy channel [default: 0.001]
    #[arg(long, value_name = "SHARE")]
    pub(crate) missing_fraction: Option<f64>,
    /// Mean rate of outages of the whole historian [default: 0.5]
    #[arg(long, value_name = "RATE")]
    pub(crate) gaps_per_day: Option<f64>,
    /// Mean rate, per channel, of periods with a frozen value [default: 0.02]
    #[arg(long, value_name = "RATE")]
    pub(crate) stuck_per_day: Option<f64>,
    /// Mean rate of rows written twice [default: 0]
    #[arg(long, value_name = "RATE")]
    pub(crate) duplicates_per_day: Option<f64>,
    /// Factor on the size of what changes from year to year: membranes, feed, sensors, settings, pumps; 0 is nothing, 1 is
    /// typical of a pilot plant, 2 the most [default: 0]
    #[arg(long, value_name = "FACTOR")]
    pub(crate) change: Option<f64>,
    /// Mean rate of new membranes, with --change [default: 1]
    #[arg(long, value_name = "RATE")]
    pub(crate) membranes_per_year: Option<f64>,
    /// Mean rate of changes to another feed, with --change [default: 2]
    #[arg(long, value_name = "RATE")]
    pub(crate) feeds_per_year: Option<f64>,
    /// Mean rate, per sensor, of being moved, exchanged or calibrated again, with --change [default: 0.5]
    #[arg(long, value_name = "RATE")]
    pub(crate) sensors_per_year: Option<f64>,
    /// Mean rate of changed control settings, with --change [default: 2]
    #[arg(long, value_name = "RATE")]
    pub(crate) settings_per_year: Option<f64>,
    /// Mean rate of pumps replaced, with --change [default: 1]
    #[arg(long, value_name = "RATE")]
    pub(crate) pumps_per_year: Option<f64>,
}

#[derive(Debug, Args)]
pub(crate) struct InspectArgs {
    /// A study file, or a log: a file (Parquet, CSV), folder or glob
    pub(crate) data: PathBuf,
    /// Override a key of the study, such as `preprocess.max_missing=0.2`
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub(crate) set: Vec<String>,
    /// The study as this one of its [profiles] has it
    #[arg(long, value_name = "NAME")]
    pub(crate) profile: Option<String>,
    /// Show all channels, not only the first of a long list
    #[arg(long)]
    pub(crate) all: bool,
    /// Print the profile as JSON
    #[arg(long, help_heading = OUTPUT)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct InitArgs {
    /// The log: a file (Parquet, CSV), folder or glob
    pub(crate) logs: PathBuf,
    /// The study file to write
    #[arg(default_value = "study.toml")]
    pub(crate) study: PathBuf,
    /// How long `calib run` on the study may take on this machine, such as 90s, 10m or 2h
    #[arg(long, value_name = "TIME", default_value = "10m", value_parser = seconds)]
    pub(crate) within: f64,
    /// A sensor to predict; may be given several times (default: three that move and are unlike each other)
    #[arg(long = "sensor", value_name = "NAME")]
    pub(crate) sensors: Vec<String>,
    /// How far ahead to predict, such as 100s or 10m (default: by the autocorrelation of the sensors)
    #[arg(long, value_name = "TIME", value_parser = seconds)]
    pub(crate) horizon: Option<f64>,
    /// Set a key of [data], such as `data.time_zone=Europe/Paris`; it holds for the study too; may be given several times
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub(crate) set: Vec<String>,
    /// Replace the study file if it is there
    #[arg(long)]
    pub(crate) force: bool,
    /// Print what was chosen as JSON
    #[arg(long, help_heading = OUTPUT)]
    pub(crate) json: bool,
}

/// A span of time as people type it, in seconds: `90s`, `10m`, `2h`, `1d`; without a unit, seconds.
fn seconds(text: &str) -> Result<f64, String> {
    let expected = || format!("expected a time such as 90s, 10m or 2h, got '{text}'");
    let unit = text.trim_start_matches(|c: char| c.is_ascii_digit() || c == '.').trim();
    let number: f64 = text[..text.len() - unit.len()].trim().parse().map_err(|_| expected())?;
    let factor = match unit {
        "" | "s" | "sec" => 1.0,
        "m" | "min" => 60.0,
        "h" => 3_600.0,
        "d" => 86_400.0,
        _ => return Err(expected()),
    };
    if number > 0.0 { Ok(number * factor) } else { Err(expected()) }
}

#[derive(Debug, Args)]
pub(crate) struct ImportArgs {
    /// The logs: a file, folder or glob
    pub(crate) logs: PathBuf,
    /// The Parquet file to write
    pub(crate) out: PathBuf,
    /// Set a key of [data], such as `data.timestamp_format=%d.%m.%Y` or `data.resample=last`; may be given several times
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub(crate) set: Vec<String>,
    /// Replace the file if it is there
    #[arg(long)]
    pub(crate) force: bool,
    /// Print what was written as JSON
    #[arg(long, help_heading = OUTPUT)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct DtwArgs {
    /// The first series: FILE.npy, FILE.csv or FILE.parquet, with :COLUMN where there are several
    pub(crate) query: String,
    /// The second series, likewise
    pub(crate) reference: String,
    /// Which steps a warping path may take and what they cost, such as symmetricP2 or
    /// rabinerJuang:3c:smoothed; may be given several times
    #[arg(long, value_name = "PATTERN", default_values = STEP_PATTERNS)]
    pub(crate) step_pattern: Vec<StepPattern>,
    /// Which pairs of samples may be matched: none, sakoe-chiba:W, slanted:W or itakura
    #[arg(long, value_name = "WINDOW", default_value = "none")]
    pub(crate) window: Window,
    /// The query may begin anywhere in the reference (patterns normalised by the query's length)
    #[arg(long)]
    pub(crate) open_begin: bool,
    /// The query may end anywhere in the reference
    #[arg(long)]
    pub(crate) open_end: bool,
    /// Distance of two samples: absolute, squared or euclidean
    #[arg(long, value_name = "DISTANCE", default_value = "absolute")]
    pub(crate) local_distance: LocalDistance,
    /// Write the warping path as CSV; wants exactly one step pattern
    #[arg(long, value_name = "FILE")]
    pub(crate) path: Option<PathBuf>,
    /// Print the distances as JSON
    #[arg(long, help_heading = OUTPUT)]
    pub(crate) json: bool,
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

impl From<Task> for TaskKind {
    fn from(task: Task) -> Self {
        match task {
            Task::Acrobot => Self::Acrobot,
            Task::CartPole => Self::CartPole,
            Task::Membrane => Self::Membrane,
            Task::Pendulum => Self::Pendulum,
            Task::PuddleWorld => Self::PuddleWorld,
        }
    }
}

impl From<Policies> for Quality {
    fn from(policy: Policies) -> Self {
        match policy {
            Policies::NearOptimal => Self::NearOptimal,
            Policies::Medium => Self::Medium,
            Policies::Random => Self::Random,
            Policies::Rule => Self::Rule,
            Policies::Perturbed => Self::Perturbed,
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

impl From<ValidityArgs> for ValidityOptions {
    fn from(args: ValidityArgs) -> Self {
        let ValidityArgs { studies, set, draw, output, resamples, seed, .. } = args;
        let extent = match (args.dry_run, args.judge_only) {
            (true, _) => ValidityExtent::Plan,
            (false, true) => ValidityExtent::Judge,
            (false, false) => ValidityExtent::Run,
        };
        Self { studies, set, draw, output, resamples, seed, extent }
    }
}
impl From<InitArgs> for ProposeOptions {
    fn from(args: InitArgs) -> Self {
        let InitArgs { logs, study, within, sensors, horizon, set, force, json: _ } = args;
        let standing = if force { Standing::Replaced } else { Standing::Kept };
        Self { logs, study, within, sensors, horizon, set, standing }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_of_time_are_read_as_people_write_them() {
        let read = ["90", "90s", "10m", "1.5 h", "2d"].map(|text| seconds(text).expect("a time"));
        assert_eq!(read, [90.0, 90.0, 600.0, 5_400.0, 172_800.0]);
        for bad in ["", "soon", "-3m", "0", "10 apples", "."] {
            assert!(seconds(bad).is_err(), "{bad}");
        }
    }
}
