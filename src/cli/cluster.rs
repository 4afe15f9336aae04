//! Arguments of `calib cluster`.

use std::{num::NonZeroUsize, path::PathBuf};

use clap::{Subcommand, ValueEnum};

use super::{StudyArgs, heading::OUTPUT};

/// What is done with a plan.
#[derive(Debug, Subcommand)]
pub(crate) enum ClusterCommand {
    /// Divide what is left to do into shards, with everything that they read
    Plan {
        #[command(flatten)]
        study: StudyArgs,
        /// Which step
        #[arg(long, value_enum, default_value_t = ClusterStep::Sweep)]
        of: ClusterStep,
        /// Minutes that a shard should take on one thread
        #[arg(long, value_name = "MINUTES", default_value_t = 30.0)]
        task_minutes: f64,
        /// The largest number of shards
        #[arg(long, value_name = "N", default_value = "1000")]
        max_tasks: NonZeroUsize,
        /// The number of shards, whatever time they take
        #[arg(long, value_name = "N")]
        shards: Option<NonZeroUsize>,
        /// The folder of the plan, which must not hold one yet
        #[arg(short = 'o', long = "plan", value_name = "PLAN")]
        plan: PathBuf,
    },
    /// Run one shard of a plan; running it twice does no harm
    Run {
        /// The folder of the plan
        plan: PathBuf,
        /// Its number, or auto: the number that Slurm, Kubernetes, PBS or GNU parallel sets in the environment
        #[arg(long, value_name = "N|auto")]
        shard: String,
    },
    /// Show which shards of a plan are done, which are not, and why
    Status {
        /// The folder of the plan
        plan: PathBuf,
        /// Print only the numbers of shards that are not done
        #[arg(long, value_name = "FORM", value_enum)]
        missing: Option<MissingAs>,
        /// Remove states of shards that are done, and half-written files of killed processes
        #[arg(long)]
        clean: bool,
        /// Print it as JSON
        #[arg(long, help_heading = OUTPUT)]
        json: bool,
    },
    /// Put the results of all shards together, or name what is missing and write nothing
    Merge {
        /// The folder of the plan
        plan: PathBuf,
    },
    /// Hand a plan to a system that runs its shards
    Submit {
        /// The folder of the plan
        plan: PathBuf,
        /// What runs them
        #[arg(long, value_enum)]
        engine: ClusterEngine,
        /// Limits, options and modules of the cluster (TOML)
        #[arg(long, value_name = "FILE")]
        config: Option<PathBuf>,
        /// Only shards that are not done
        #[arg(long)]
        missing_only: bool,
        /// Print the scripts, and stop
        #[arg(long)]
        dry_run: bool,
    },
}

/// Steps that can be divided.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ClusterStep {
    /// The sweeps of all models and deployments
    Sweep,
}

/// How numbers of shards are printed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum MissingAs {
    /// As an array of Slurm: 0,3-7
    Slurm,
    /// One per line
    Lines,
}

/// What runs shards.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ClusterEngine {
    /// Slurm, by sbatch
    Slurm,
    /// Ray, by a Python program
    Ray,
    /// Kubernetes; calib writes the manifests and applies nothing
    Kubernetes,
}
