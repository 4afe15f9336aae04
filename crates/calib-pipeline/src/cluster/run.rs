//! Runs one shard.

use std::{
    collections::BTreeSet,
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
    time::Duration,
};

use calib_base::{
    StepError,
    clock::Stopwatch,
    memory,
    outcome::Freshness,
    output::{Printer, bytes, counted},
};
use calib_core::{Cancelled, Monitor};
use calib_files::FileError;
use calib_sweep::{
    EnvironmentId, PassId, Plan, ReadyPass, SweepError, Unit, UnitRuns, remove_states,
};
use rayon::prelude::*;

use crate::cluster::{
    attempt::{AttemptEnd, AttemptFile},
    inputs::Inputs,
    plan_file::{OpenedPlan, PlannedPass, Shard},
    results::{self, Completeness, Header, UnitsInOrder},
    sink::ShardSink,
};

/// A finished shard.
#[derive(Clone, Copy, Debug)]
pub struct ClusterShard {
    /// The number of the shard.
    pub number: usize,
    /// Whether it was already done.
    pub freshness: Freshness,
    /// Number of new training runs.
    pub made: usize,
    /// Duration of this run.
    pub took: Duration,
}

/// Makes the missing results of a shard.
pub(crate) fn run(
    directory: &Path,
    number: usize,
    printer: &Printer,
) -> Result<ClusterShard, StepError> {
    let opened = OpenedPlan::of(directory)?;
    opened.plan.maker.check()?;
    let shard = opened.shard(number)?;
    let attempt = AttemptFile::begin(&opened.attempts(number));
    let ended = ShardRun { opened: &opened, number, shard, attempt: &attempt, printer }.run();
    attempt.ends(match &ended {
        Ok(_) => AttemptEnd::Done,
        Err(error) if error.was_cancelled() => AttemptEnd::Stopped,
        Err(error) => AttemptEnd::Failed(error.to_string()),
    });
    ended
}

struct ShardRun<'a> {
    opened: &'a OpenedPlan,
    number: usize,
    shard: &'a Shard,
    attempt: &'a AttemptFile,
    printer: &'a Printer,
}

/// A ready pass of the shard, with its predicted time.
struct ShardPass<'p> {
    plan: &'p Plan<'p>,
    ready: ReadyPass<'p>,
    name: String,
    predicted_secs: f64,
}

impl ShardRun<'_> {
    fn run(&self) -> Result<ClusterShard, StepError> {
        let clock = Stopwatch::start();
        let opened = self.opened;
        let number = self.number;
        let units = match opened.read(number) {
            Ok(Some(results)) if results.completeness == Completeness::Whole => {
                let freshness = Freshness::Kept;
                let took = clock.elapsed();
                return Ok(ClusterShard { number, freshness, made: 0, took });
            }
            Ok(results) => results.map_or_else(UnitsInOrder::new, |results| results.units),
            // Without an earlier attempt, the file cannot be a shard's.
            Err(_) if self.attempt.is_first() => {
                return Err(FileError::Foreign { path: opened.results(number) }.into());
            }
            Err(error) => {
                let told = error.to_string();
                self.printer.warn(&format!("{told}; shard {number} begins anew"));
                // The damaged file must not be merged with new results.
                calib_files::remove_file(&opened.results(number))?;
                UnitsInOrder::new()
            }
        };
        self.check_memory()?;
        let before = self.before()?;
        let header = Header::new(opened.fingerprint.to_string(), number, &opened.plan.maker);
        let states = opened.states(number);
        let sink = ShardSink::new(opened.results(number), states.clone(), header, units);
        let had = sink.training_runs();
        let parts: BTreeSet<usize> = self.shard.passes.iter().map(|pass| pass.part).collect();
        let failed: Result<usize, StepError> =
            parts.into_iter().map(|part| self.part(part, &before, &sink)).sum();
        // Finished work is saved, however the shard ends.
        let written = sink.flush().map_err(unfinished);
        let failed = failed?;
        written?;
        if failed > 0 {
            return Err(StepError::Incomplete(format!(
                "{} of shard {number} failed; `calib cluster status` names them",
                counted(failed, "pass")
            )));
        }
        sink.complete().map_err(unfinished)?;
        let _ = remove_states(&states);
        let made = sink.training_runs() - had;
        let took = clock.elapsed();
        Ok(ClusterShard { number, freshness: Freshness::Made, made, took })
    }

    /// Refuses a shard that would run out of memory halfway.
    fn check_memory(&self) -> Result<(), StepError> {
        let needed = self.shard.memory;
        match memory::available() {
            Some(available) if needed > available => Err(StepError::Incomplete(format!(
                "shard {} may take {} of memory and {} are available; ask for more memory a task",
                self.number,
                bytes(needed),
                bytes(available)
            ))),
            _ => Ok(()),
        }
    }

    /// Returns the results of the earlier stages. In a race they decide which settings continue.
    fn before(&self) -> Result<UnitsInOrder, StepError> {
        let mut all = UnitsInOrder::new();
        for earlier in 0..self.shard.stage {
            for number in self.opened.plan.of_stage(earlier) {
                let results = self.opened.read(number)?;
                match results.filter(|results| results.completeness == Completeness::Whole) {
                    Some(results) => results::add(&mut all, results.units.into_values()),
                    None => {
                        return Err(StepError::Incomplete(format!(
                            "shard {} follows from shard {number}, which is not done",
                            self.number
                        )));
                    }
                }
            }
        }
        Ok(all)
    }

    /// Makes the passes of one part. Returns the number of failures.
    fn part(
        &self,
        part: usize,
        before: &UnitsInOrder,
        sink: &ShardSink,
    ) -> Result<usize, StepError> {
        let plan = &self.opened.plan;
        let directory = self.opened.inputs(part);
        let planned: Vec<&PlannedPass> =
            self.shard.passes.iter().filter(|pass| pass.part == part).collect();
        let passes: Vec<PassId> =
            planned.iter().map(|planned| plan.pass(planned)).collect::<Result<_, StepError>>()?;
        let wanted: BTreeSet<EnvironmentId> = passes.iter().map(|pass| pass.environment).collect();
        let inputs = Inputs::open(&directory, plan.sweep(part)?, wanted)?;
        let environments = inputs.environments()?;
        let baselines = inputs.baselines();
        let sweep = inputs.plan(&environments, baselines.as_ref());
        let mut earlier = inputs.stored.clone();
        results::add(&mut earlier, before.values().cloned());
        let earlier =
            sweep.known(&|unit, key| earlier.get(&(unit.clone(), key.to_owned())).cloned());
        let ready = sweep.ready(&passes, earlier.whole());
        let tasks: Vec<ShardPass<'_>> = ready
            .into_iter()
            .zip(planned.iter().zip(&passes))
            .map(|(ready, (planned, pass))| ShardPass {
                name: name(&plan.parts[part].name(), planned, pass),
                plan: &sweep,
                ready,
                predicted_secs: planned.secs,
            })
            .collect();
        let progress = self.printer.progress();
        let steps = plan.sweep(part)?.span.steps;
        progress.begin("training", (tasks.len() * steps) as u64);
        let writable = AtomicBool::new(true);
        let ended: Vec<TaskEnd> = tasks
            .par_iter()
            .with_max_len(1)
            .map(|task| self.task(task, &inputs.stored, sink, &writable, &progress))
            .collect();
        drop(progress);
        let mut failed = 0;
        for (task, ended) in tasks.iter().zip(ended) {
            match ended {
                TaskEnd::Done => {}
                TaskEnd::Stopped => return Err(Cancelled.into()),
                TaskEnd::Failed(told) => {
                    failed += 1;
                    self.printer.error(&format!("{}: {told}", task.name));
                }
                TaskEnd::LeftOut => failed += 1,
            }
        }
        Ok(failed)
    }

    /// Makes a pass. A failure does not stop the other passes, unless the results cannot be written.
    fn task(
        &self,
        task: &ShardPass<'_>,
        stored: &UnitsInOrder,
        sink: &ShardSink,
        writable: &AtomicBool,
        monitor: &dyn Monitor,
    ) -> TaskEnd {
        let found = |unit: &Unit, key: &str| -> Option<UnitRuns> {
            let stored = stored.get(&(unit.clone(), key.to_owned())).cloned();
            UnitRuns::merged(stored.into_iter().chain(sink.get(unit, key)))
        };
        if task.ready.is_found(&found) {
            return TaskEnd::Done;
        }
        if !writable.load(Ordering::Relaxed) {
            return TaskEnd::LeftOut;
        }
        // Stops before the attempt file is written: hundreds of entries would take longer than a
        // batch system waits.
        if monitor.check().is_err() {
            return TaskEnd::Stopped;
        }
        self.attempt.begins(&task.name);
        let clock = Stopwatch::start();
        match task.plan.train_ready(&task.ready, &found, sink, monitor) {
            Ok(made) => {
                self.attempt.made(&task.name, made.len(), task.predicted_secs, clock.elapsed());
                TaskEnd::Done
            }
            Err(SweepError::Cancelled(_)) => TaskEnd::Stopped,
            Err(error) => {
                if matches!(error, SweepError::File(_)) {
                    writable.store(false, Ordering::Relaxed);
                }
                let told = StepError::from(error).to_string();
                self.attempt.failed(&task.name, &told);
                TaskEnd::Failed(told)
            }
        }
    }
}

/// The end of a pass.
enum TaskEnd {
    Done,
    Stopped,
    Failed(String),
    /// The pass was not begun.
    LeftOut,
}

/// Returns the name of a pass for messages.
fn name(part: &str, planned: &PlannedPass, pass: &PassId) -> String {
    let sensors: Vec<&str> = pass.sensors.iter().map(String::as_str).take(3).collect();
    let more = if pass.sensors.len() > 3 { ", ..." } else { "" };
    let of_part = if part.is_empty() { String::new() } else { format!(" of {part}") };
    format!("{}{more} in {}, run {}{of_part}", sensors.join(", "), planned.environment, planned.run)
}

/// Converts a failed write. The plan is not at fault, and another attempt may find room on the disk.
fn unfinished(error: SweepError) -> StepError {
    StepError::Incomplete(StepError::from(error).to_string())
}
