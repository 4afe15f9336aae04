//! Grammar of the command line: the commands, their arguments and their help.

mod build;
mod cluster;
mod dtw;
mod heading;
mod logs;
mod simulate;
mod status;
mod study;

use std::{path::PathBuf, sync::LazyLock};

use calib_pipeline::OutputFormat;
use clap::{Args, Parser, Subcommand, ValueEnum, builder::ArgPredicate};
use clap_complete::Shell;
use heading::OUTPUT;
use study::NO_STUDY;
pub(crate) use {
    build::{BuildModelArgs, DeviceArgs, PretrainArgs, RepresentArgs, RunArgs},
    cluster::{ClusterCommand, ClusterEngine, MissingAs},
    dtw::DtwArgs,
    logs::{ImportArgs, InitArgs, InspectArgs},
    simulate::{PlantArgs, QuickstartArgs, SimulateArgs, Task},
    status::{Address, StatusArgs},
    study::{CheckArgs, ControlArgs, EvaluateArgs, StudyArgs, ValidityArgs},
};

use crate::output::AfterInterruption;

/// Returns the version, the commit if the build set `CALIB_COMMIT`, and whether libtorch is built in.
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

/// Display order of options after those of each command, which are fewer, and before `--help`, which has 999.
const LAST: usize = 998;

#[derive(Clone, Debug, Args)]
pub(crate) struct GlobalArgs {
    /// Print only results and errors
    #[arg(short, long, global = true, help_heading = OUTPUT)]
    pub(crate) quiet: bool,
    /// Print more: the result of each step, all reasons of a verdict, and the elapsed time
    #[arg(short, long, global = true, conflicts_with = "quiet", help_heading = OUTPUT)]
    pub(crate) verbose: bool,
    /// Append all messages and results to a file, with times, also those that `--quiet` hides
    #[arg(long, global = true, value_name = "FILE", help_heading = OUTPUT)]
    pub(crate) log: Option<PathBuf>,
    /// When to use colour; calib obeys `NO_COLOR`
    #[arg(long, global = true, value_enum, default_value_t = ColorChoice::Auto, help_heading = OUTPUT)]
    pub(crate) color: ColorChoice,
    /// Number of threads (default: one per core); results do not depend on it
    #[arg(long, global = true, value_name = "N", display_order = LAST)]
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
    /// Look at a log, and write a study of it with a reason for every key
    Init(InitArgs),
    /// Show what is in a log and what preprocessing would keep
    Inspect(InspectArgs),
    /// Convert logs of any form (CSV, long tables, one file per tag) into one wide Parquet file
    Import(ImportArgs),
    /// Run a study from its log to the verdict, and skip steps that are done
    Run(RunArgs),
    /// Train or import representations of the states, score them, and choose one
    Represent(RepresentArgs),
    /// Build the calibration model: tables of neighbours, or a network
    BuildModel(BuildModelArgs),
    /// Roll the model out, and compare rollouts with the recorded log
    Rollout(StudyArgs),
    /// Pre-train one agent per sensor on a part of the log, for `sweep` to start from
    Pretrain(PretrainArgs),
    /// Train agents with every setting of the grid: in the model, on the replayed log and on the held-out period
    Sweep(DeviceArgs),
    /// Choose a setting, check it on the held-out period, and write the report
    #[command(mut_arg("study", |arg| {
        arg.required(false).required_unless_present("runs").default_value_if("runs", ArgPredicate::IsPresent, NO_STUDY)
    }))]
    Evaluate(EvaluateArgs),
    /// For agents that act: read a log with actions, train every setting in models of it, and recommend one
    Control(ControlArgs),
    /// Show how a study stands, also while it runs: what is done, how long it takes, and how the settings stand so far
    Status(StatusArgs),
    /// Verify that a results folder is as calib wrote it
    Check(CheckArgs),
    /// Divide a study's sweeps between processes, on one machine or many
    Cluster {
        #[command(subcommand)]
        command: ClusterCommand,
    },
    /// Measure how well calib chooses, over several studies with held-out data
    Validity(ValidityArgs),
    /// Dynamic time warping distance between two series
    Dtw(DtwArgs),
    /// Explain a key of a study, such as agent.gamma; without one, list the sections
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
    /// Returns what the same command does after an interruption. Finished
    /// steps of a study stay, and parts of long steps.
    pub(crate) fn after_interruption(&self) -> AfterInterruption {
        let goes_on = match self {
            Self::Quickstart(_)
            | Self::Run(_)
            | Self::Represent(_)
            | Self::BuildModel(_)
            | Self::Pretrain(_)
            | Self::Sweep(_)
            | Self::Control(_)
            | Self::Validity(_)
            | Self::Cluster { command: ClusterCommand::Run { .. } } => true,
            // A plant has one file per day, so finished days stay. The log of a task is one file.
            Self::Simulate(args) => args.task.task.is_none(),
            Self::Init(_)
            | Self::Inspect(_)
            | Self::Import(_)
            | Self::Rollout(_)
            | Self::Evaluate(_)
            | Self::Status(_)
            | Self::Check(_)
            | Self::Cluster { .. }
            | Self::Dtw(_)
            | Self::Explain { .. }
            | Self::Completions { .. }
            | Self::Man { .. } => false,
        };
        if goes_on { AfterInterruption::GoesOn } else { AfterInterruption::BeginsAnew }
    }

    /// Returns the format of the result: text for people, or JSON.
    pub(crate) fn output_format(&self) -> OutputFormat {
        let json = match self {
            Self::Run(RunArgs { study: DeviceArgs { study: args, .. }, .. })
            | Self::Rollout(args)
            | Self::Sweep(DeviceArgs { study: args, .. })
            | Self::Control(ControlArgs { study: args, .. })
            | Self::Evaluate(EvaluateArgs { study: args, .. }) => args.json,
            Self::Represent(args) => args.study.json,
            Self::Pretrain(args) => args.study.json,
            Self::BuildModel(args) => args.study.json,
            Self::Quickstart(args) => args.json,
            Self::Simulate(args) => args.json,
            Self::Init(args) => args.json,
            Self::Inspect(args) => args.json,
            Self::Import(args) => args.json,
            Self::Status(args) => args.json,
            Self::Check(args) => args.json,
            Self::Validity(args) => args.json,
            Self::Dtw(args) => args.json,
            Self::Explain { json, .. }
            | Self::Cluster { command: ClusterCommand::Status { json, .. } } => *json,
            Self::Cluster { command: ClusterCommand::Plan { study, .. } } => study.json,
            Self::Cluster { .. } | Self::Completions { .. } | Self::Man { .. } => false,
        };
        if json { OutputFormat::Json } else { OutputFormat::Text }
    }
}
