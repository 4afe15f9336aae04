//! Arguments of the commands that simulate.

use std::path::PathBuf;

use calib_control::{Quality, TaskKind};
use clap::{Args, ValueEnum};

use super::heading::OUTPUT;

#[derive(Debug, Args)]
pub(crate) struct QuickstartArgs {
    /// Where the data, the study file and the report go
    #[arg(default_value = "calib-quickstart")]
    pub(crate) directory: PathBuf,
    /// Seed of all random numbers
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    /// Print the verdict as JSON
    #[arg(long, help_heading = OUTPUT)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct SimulateArgs {
    /// The folder for the day files; or a study file, whose [simulate] describes what to write to its data.path
    #[arg(value_name = "DIRECTORY or STUDY")]
    pub(crate) target: PathBuf,
    #[command(flatten)]
    pub(crate) plant: PlantArgs,
    #[command(flatten)]
    pub(crate) task: TaskArgs,
    /// Override a key of the study, such as `simulate.days=2`; may be given several times
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub(crate) set: Vec<String>,
    /// Use this profile from the study's [profiles]
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
    /// An agent that has learned the task
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
    /// Seed of all random numbers [default: 0]
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
