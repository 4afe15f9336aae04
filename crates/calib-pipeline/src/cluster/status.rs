//! What is done of a plan, what is not, and why.

use std::path::Path;

use calib_base::{
    StepError,
    options::{ArrayOf, ClusterStatusOptions, Leftovers},
    outcome::Outcome,
    output::{Printer, bytes, count, counted, span, table},
};
use calib_files::{Below, host_name, remove_temporaries};
use calib_sweep::remove_states;
use schemars::JsonSchema;
use serde::Serialize;

use crate::cluster::{
    attempt::{self, Attempt, RunOutcome},
    engines::queue,
    missing::ranges,
    plan_file::{Opened, PlanFile},
    results::Extent,
};

/// What a plan takes.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct Summary {
    shards: usize,
    stages: usize,
    units: usize,
    /// Predicted seconds on one thread, of all shards and of the longest.
    secs: f64,
    longest_secs: f64,
    /// Predicted seconds where every shard has a machine.
    together_secs: f64,
    /// Bytes of memory that a shard takes at most.
    memory: u64,
}

/// What a plan takes.
pub(crate) fn summary(plan: &PlanFile) -> Summary {
    let secs = || plan.shards.iter().map(|shard| shard.secs);
    let of_stage =
        |stage| plan.of_stage(stage).map(|number| plan.shards[number].secs).fold(0.0, f64::max);
    Summary {
        shards: plan.shards.len(),
        stages: plan.stages(),
        units: plan.shards.iter().map(|shard| shard.units(plan)).sum(),
        secs: secs().sum(),
        longest_secs: secs().fold(0.0, f64::max),
        together_secs: (0..plan.stages()).map(of_stage).sum(),
        memory: plan.shards.iter().map(|shard| shard.memory).max().unwrap_or(0),
    }
}

impl Summary {
    /// In words.
    pub(crate) fn lines(&self) -> Vec<String> {
        if self.shards == 0 {
            return vec!["nothing is left to train".to_owned()];
        }
        let stages = match self.stages {
            1 => String::new(),
            stages => format!(" in {stages} stages, one after the other"),
        };
        vec![
            format!(
                "{}{stages}, {}",
                counted(self.shards, "shard"),
                counted(self.units, "training run")
            ),
            format!(
                "predicted: {} of one thread in all, {} the longest shard, {} where every shard has a core; up to {} of \
                 memory a shard",
                span(self.secs),
                span(self.longest_secs),
                span(self.together_secs),
                bytes(self.memory)
            ),
        ]
    }
}

/// How a shard stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum State {
    Done,
    /// Some of its units are there.
    Begun,
    Missing,
    /// Its file is not what it should be.
    Faulty,
}

#[derive(Debug, Serialize, JsonSchema)]
struct Standing {
    shard: usize,
    stage: usize,
    state: State,
    units: usize,
    of: usize,
    attempts: usize,
    /// Whether an attempt is at work, as far as that can be seen from this machine.
    is_running: bool,
    predicted_secs: f64,
    /// What its passes took, in all attempts.
    secs: f64,
    /// What is to be known of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    note: Option<String>,
    /// What the queue says, where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    queue: Option<String>,
}

/// The answer for machines.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct Status {
    plan: Summary,
    done: usize,
    shards: Vec<Standing>,
}

impl Status {
    /// How the shards of a plan stand.
    pub(crate) fn of(opened: &Opened) -> Self {
        let queued = queue::states(&opened.directory);
        let of_shard = |number| {
            let queue = queued.get(&number).cloned();
            Standing { queue, ..standing(opened, number) }
        };
        let shards: Vec<Standing> = (0..opened.plan.shards.len()).map(of_shard).collect();
        let done = shards.iter().filter(|shard| shard.state == State::Done).count();
        Self { plan: summary(&opened.plan), done, shards }
    }

    /// Whether some shards are begun or in a queue, and not done.
    pub(crate) fn is_running(&self) -> bool {
        self.shards
            .iter()
            .any(|shard| shard.state != State::Done && (shard.is_running || shard.queue.is_some()))
    }

    /// Tell it, of the plan in `directory`.
    ///
    /// # Errors
    /// If it cannot be passed on.
    pub(crate) fn tell(&self, directory: &Path, printer: &Printer) -> Result<(), StepError> {
        tell(directory, &self.shards, self.done, printer)
    }
}

/// Say how a plan stands.
pub(crate) fn status(
    directory: &Path,
    options: ClusterStatusOptions,
    printer: &Printer,
) -> Result<Outcome, StepError> {
    let opened = Opened::of(directory)?;
    if options.leftovers == Leftovers::Removed {
        clean(&opened)?;
    }
    let status = Status::of(&opened);
    let is_done = status.done == status.shards.len();
    let outcome = if is_done { Outcome::Done } else { Outcome::Incomplete };
    match options.missing {
        Some(ArrayOf::Slurm) => printer.result(&ranges(&missing(&opened)))?,
        Some(ArrayOf::Lines) => {
            for number in missing(&opened) {
                printer.result(&number.to_string())?;
            }
        }
        None if printer.is_json() => printer.json(&status)?,
        None => status.tell(directory, printer)?,
    }
    Ok(outcome)
}

/// Shards whose results are not there, or not what they should be.
pub(crate) fn missing(opened: &Opened) -> Vec<usize> {
    let is_missing = |number: &usize| standing(opened, *number).state != State::Done;
    (0..opened.plan.shards.len()).filter(is_missing).collect()
}

fn standing(opened: &Opened, number: usize) -> Standing {
    let shard = &opened.plan.shards[number];
    let attempts = attempt::read(&opened.attempts(number));
    let (state, units, fault) = match opened.read(number) {
        Ok(Some(results)) => match results.extent {
            Extent::Whole => (State::Done, results.units.len(), None),
            Extent::Partial => (State::Begun, results.units.len(), None),
        },
        Ok(None) if attempts.is_empty() => (State::Missing, 0, None),
        Ok(None) => (State::Begun, 0, None),
        Err(error) => (State::Faulty, 0, Some(error.to_string())),
    };
    let note = match state {
        State::Done => None,
        _ => fault.or_else(|| attempts.last().map(told)),
    };
    let made = attempts.iter().flat_map(|attempt| &attempt.made);
    Standing {
        shard: number,
        stage: shard.stage,
        state,
        units,
        of: shard.units(&opened.plan),
        attempts: attempts.len(),
        is_running: attempts
            .iter()
            .any(|attempt| attempt.ended == RunOutcome::NotYet && is_running(attempt)),
        predicted_secs: shard.secs,
        // Of nothing the sum is -0.
        secs: made.map(|made| made.secs).sum::<f64>() + 0.0,
        note,
        queue: None,
    }
}

/// What is to be known of the last attempt.
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
        RunOutcome::Done => format!("{place} was done"),
        RunOutcome::Stopped => format!("{place} was asked to stop{doing}, and goes on from there"),
        RunOutcome::Failed(reason) => format!("{place}: {reason}{failed}"),
        RunOutcome::NotYet if is_running(attempt) => format!("{place} runs{doing}{failed}"),
        RunOutcome::NotYet if attempt.host == host_name() => format!(
            "{place} was killed{doing}{failed}: it ran out of memory, time or disk, or somebody ended it"
        ),
        RunOutcome::NotYet => format!(
            "{place} runs{doing}, or was killed there{failed}: out of memory, time or disk, or the machine was lost"
        ),
    }
}

/// Whether it runs on this machine, as far as that can be seen.
fn is_running(attempt: &Attempt) -> bool {
    let process = Path::new("/proc").join(attempt.process.to_string());
    attempt.host == host_name() && process.exists()
}

fn tell(
    directory: &Path,
    shards: &[Standing],
    done: usize,
    printer: &Printer,
) -> Result<(), StepError> {
    let of = |wanted| shards.iter().filter(move |shard| shard.state == wanted).count();
    printer.result(&format!(
        "{done} of {} done, {} begun, {} missing, {} faulty; {} of {} training runs",
        counted(shards.len(), "shard"),
        of(State::Begun),
        of(State::Missing),
        of(State::Faulty),
        count(shards.iter().map(|shard| shard.units).sum()),
        count(shards.iter().map(|shard| shard.of).sum()),
    ))?;
    let left: f64 =
        shards.iter().filter(|of| of.state != State::Done).map(|of| of.predicted_secs).sum();
    if left > 0.0 {
        printer.result(&format!("left: {} of one thread, as predicted", span(left)))?;
    }
    let rows: Vec<Vec<String>> = shards
        .iter()
        .filter(|shard| shard.note.is_some() || shard.queue.is_some())
        .map(|shard| {
            let units = format!("{} of {}", count(shard.units), count(shard.of));
            let notes = [shard.queue.clone(), shard.note.clone()];
            let notes: Vec<String> = notes.into_iter().flatten().collect();
            vec![shard.shard.to_string(), units, notes.join("; ")]
        })
        .collect();
    if !rows.is_empty() {
        printer.lines(&table(&["shard", "training runs", ""], &rows))?;
    }
    let place = calib_study::shell_words([directory.display().to_string()]);
    if done == shards.len() {
        printer.next(&[format!("calib cluster merge {place}")]);
    }
    Ok(())
}

/// Remove what nobody needs any more: states of shards that are done, and what killed processes left half-written.
fn clean(opened: &Opened) -> Result<(), StepError> {
    for number in 0..opened.plan.shards.len() {
        if standing(opened, number).state == State::Done {
            remove_states(&opened.states(number))?;
        }
    }
    let shards = opened.directory.join("shards");
    if shards.is_dir() {
        remove_temporaries(&shards, Below::Ours)?;
    }
    Ok(())
}
