//! The status of a plan: which shards are done, which are not, and why.

use std::path::{Path, PathBuf};

use calib_base::{
    StepError,
    options::{ArrayOf, ClusterStatusOptions, Leftovers},
};
use calib_files::{Below, host_name, remove_temporaries};
use calib_sweep::{RaceKind, remove_states};
use schemars::JsonSchema;
use serde::Serialize;

use crate::cluster::{
    attempt::{self, Attempt, AttemptEnd},
    engines::queue,
    plan_file::{OpenedPlan, PlanFile, Shard, shards_in},
    results::{self, Completeness, UnitsInOrder},
};

/// Size and predicted cost of a plan.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct Summary {
    pub(crate) shards: usize,
    pub(crate) stages: usize,
    pub(crate) units: usize,
    /// Number of training runs: one for each setting of a unit. In a race it is an upper bound.
    pub(crate) training_runs: usize,
    /// Whether a sweep is a race.
    #[serde(skip)]
    pub(crate) has_race: bool,
    /// Predicted seconds on one thread, for all shards; the next field is for the longest shard.
    pub(crate) secs: f64,
    pub(crate) longest_secs: f64,
    /// Predicted seconds if every shard has its own machine.
    pub(crate) together_secs: f64,
    /// Largest memory of a shard, in bytes.
    pub(crate) memory: u64,
}

/// Summarises the size of a plan.
pub(crate) fn summary(plan: &PlanFile) -> Summary {
    let secs = plan.shards.iter().map(|shard| shard.secs);
    let mut sweeps = plan.parts.iter().filter_map(|part| part.sweep.as_ref());
    Summary {
        shards: plan.shards.len(),
        stages: plan.stages(),
        units: plan.shards.iter().map(|shard| shard.units(plan)).sum(),
        training_runs: plan.shards.iter().map(Shard::training_runs).sum(),
        has_race: sweeps.any(|sweep| sweep.study.sweep.race == RaceKind::Halving),
        secs: secs.clone().sum(),
        longest_secs: secs.fold(0.0, f64::max),
        together_secs: (0..plan.stages())
            .map(|stage| {
                plan.of_stage(stage).map(|number| plan.shards[number].secs).fold(0.0, f64::max)
            })
            .sum(),
        memory: plan.shards.iter().map(|shard| shard.memory).max().unwrap_or(0),
    }
}

/// State of a shard.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum State {
    Done,
    /// Some of its units are done.
    Begun,
    Missing,
    /// Its file is damaged.
    Faulty,
}

#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct ShardStatus {
    pub(crate) shard: usize,
    pub(crate) stage: usize,
    pub(crate) state: State,
    pub(crate) units: usize,
    #[serde(rename = "of")]
    pub(crate) all_units: usize,
    pub(crate) training_runs: usize,
    /// Number of training runs that the shard is to make. In a race it is an upper bound until the shard is done.
    pub(crate) all_training_runs: usize,
    pub(crate) attempts: usize,
    /// Whether an attempt is running, as far as this machine can see.
    pub(crate) is_running: bool,
    pub(crate) predicted_secs: f64,
    /// Seconds that its passes took, over all attempts.
    pub(crate) secs: f64,
    /// A note on the shard.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) note: Option<String>,
    /// The state that the queue reports, if there is a queue.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) queue: Option<String>,
}

/// Status of a plan for `--json`.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct Status {
    pub(crate) plan: Summary,
    pub(crate) done: usize,
    pub(crate) shards: Vec<ShardStatus>,
}

impl Status {
    pub(crate) fn of(opened: &OpenedPlan) -> Self {
        let queued = queue::states(&opened.directory);
        let shards: Vec<ShardStatus> = (0..opened.plan.shards.len())
            .map(|number| {
                let queue = queued.get(&number).cloned();
                ShardStatus { queue, ..standing(opened, number) }
            })
            .collect();
        let done = shards.iter().filter(|shard| shard.state == State::Done).count();
        Self { plan: summary(&opened.plan), done, shards }
    }

    /// Whether a shard that is not done is running or in a queue.
    pub(crate) fn is_running(&self) -> bool {
        self.shards
            .iter()
            .any(|shard| shard.state != State::Done && (shard.is_running || shard.queue.is_some()))
    }

    /// Whether every shard is done.
    pub(crate) fn is_done(&self) -> bool {
        self.done == self.shards.len()
    }

    /// Returns the numbers of the shards that are not done.
    pub(crate) fn missing(&self) -> Vec<usize> {
        let missing = self.shards.iter().filter(|shard| shard.state != State::Done);
        missing.map(|shard| shard.shard).collect()
    }
}

/// The status of a plan, and which part of it was requested.
#[derive(Debug)]
pub struct ClusterStatus {
    pub(crate) directory: PathBuf,
    pub(crate) status: Status,
    /// If set, prints only the numbers of the shards that are not done.
    pub(crate) only_missing: Option<ArrayOf>,
}

impl ClusterStatus {
    /// Returns the number of shards in the plan.
    pub fn shards(&self) -> usize {
        self.status.shards.len()
    }

    /// Returns the numbers of the shards that are not done.
    pub fn missing(&self) -> Vec<usize> {
        self.status.missing()
    }
}

pub(crate) fn status(
    directory: &Path,
    options: ClusterStatusOptions,
) -> Result<ClusterStatus, StepError> {
    let opened = OpenedPlan::of(directory)?;
    if options.leftovers == Leftovers::Removed {
        clean(&opened)?;
    }
    let directory = directory.to_owned();
    let status = Status::of(&opened);
    Ok(ClusterStatus { directory, status, only_missing: options.missing })
}

/// Returns the shards whose results are missing or invalid.
pub(crate) fn missing(opened: &OpenedPlan) -> Vec<usize> {
    (0..opened.plan.shards.len())
        .filter(|number| standing(opened, *number).state != State::Done)
        .collect()
}

fn standing(opened: &OpenedPlan, number: usize) -> ShardStatus {
    let shard = &opened.plan.shards[number];
    let attempts = attempt::read(&opened.attempts(number));
    let none = UnitsInOrder::new();
    let (state, units, fault) = match opened.read(number) {
        Ok(Some(results)) => match results.completeness {
            Completeness::Whole => (State::Done, results.units, None),
            Completeness::Partial => (State::Begun, results.units, None),
        },
        Ok(None) if attempts.is_empty() => (State::Missing, none, None),
        Ok(None) => (State::Begun, none, None),
        Err(error) => (State::Faulty, none, Some(error.to_string())),
    };
    let training_runs = results::training_runs(&units);
    let note = match state {
        State::Done => None,
        _ => fault.or_else(|| attempts.last().map(told)),
    };
    let made = attempts.iter().flat_map(|attempt| &attempt.made);
    ShardStatus {
        shard: number,
        stage: shard.stage,
        state,
        units: units.len(),
        all_units: shard.units(&opened.plan),
        training_runs,
        all_training_runs: match state {
            State::Done => training_runs,
            _ => shard.training_runs(),
        },
        attempts: attempts.len(),
        is_running: attempts
            .iter()
            .any(|attempt| attempt.ended == AttemptEnd::NotYet && is_running(attempt)),
        predicted_secs: shard.secs,
        // An empty sum is -0.
        secs: made.map(|made| made.secs).sum::<f64>() + 0.0,
        note,
        queue: None,
    }
}

/// Describes the last attempt.
fn told(attempt: &Attempt) -> String {
    let place = format!("attempt {} on {}", attempt.before + 1, attempt.host);
    let doing = match attempt.doing.as_slice() {
        [] => String::new(),
        doing => format!(" at {}", doing.join("; ")),
    };
    let failed = match attempt.failed.as_slice() {
        [] => String::new(),
        failed => format!(" ({})", failed.join("; ")),
    };
    match &attempt.ended {
        AttemptEnd::Done => format!("{place} was done"),
        AttemptEnd::Stopped => format!("{place} was asked to stop{doing}, and goes on from there"),
        AttemptEnd::Failed(reason) => format!("{place}: {reason}{failed}"),
        AttemptEnd::NotYet if is_running(attempt) => format!("{place} runs{doing}{failed}"),
        AttemptEnd::NotYet if attempt.host == host_name() => format!(
            "{place} was killed{doing}{failed}: it ran out of memory, time or disk, or somebody ended it"
        ),
        AttemptEnd::NotYet => format!(
            "{place} runs{doing}, or was killed there{failed}: out of memory, time or disk, or the machine was lost"
        ),
    }
}

/// Whether the attempt is running on this machine, as far as calib can see.
fn is_running(attempt: &Attempt) -> bool {
    let process = Path::new("/proc").join(attempt.process.to_string());
    attempt.host == host_name() && process.exists()
}

/// Removes files that are no longer needed: states of finished shards, and partial files of killed processes.
fn clean(opened: &OpenedPlan) -> Result<(), StepError> {
    for number in 0..opened.plan.shards.len() {
        if standing(opened, number).state == State::Done {
            remove_states(&opened.states(number))?;
        }
    }
    let shards = shards_in(&opened.directory);
    if shards.is_dir() {
        remove_temporaries(&shards, Below::Ours)?;
    }
    Ok(())
}
