//! Estimates the time of a sweep before it runs.

use std::{collections::BTreeMap, path::Path};

use calib_base::{
    StepError,
    cost::StepCost,
    disk_room,
    log::context::RunContext,
    output::{bytes, count, counted, duration_of_secs},
};
use calib_core::{RowIndex, RowStream};
use calib_model_steps::model::{model_files, starts};
use calib_study::{Job, StepKind, Study};
use calib_sweep::{RaceKind, RunStream};
use schemars::JsonSchema;
use serde::Serialize;

use crate::{
    agents::pretrain_files,
    sweep::{
        cost::{Cost, MEASURED_STEPS, TrainedInPass},
        groups::StudyGroup,
        plan::{DryRunTally, Memory, Sizes, SweepPlan, agents_of},
        setting::{candidates_of, scorable},
        streams::Streams,
    },
};

/// Bytes of one setting's result in the file of a unit, and of each point of its learning curve.
const ROW_BYTES: u64 = 750;
const POINT_BYTES: u64 = 82;

/// Expected cost of the rest of a sweep, from measurements of some steps on this machine.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Expected {
    /// Number of passes over streams. One pass trains all settings for the sensors with one discount factor.
    pub(crate) passes: usize,
    /// Number of threads that share the passes.
    pub(crate) threads: usize,
    /// Seconds until the last pass ends, if nothing else runs.
    pub(crate) secs: f64,
    /// Processor seconds of all threads together.
    pub(crate) processor_secs: f64,
    /// Bytes of results on disk.
    pub(crate) disk: u64,
}

impl Expected {
    /// Returns the total of several sweeps that run one after the other.
    pub(crate) fn in_all<'a>(sweeps: impl Iterator<Item = &'a Self>) -> Option<Self> {
        sweeps.cloned().reduce(|all, sweep| Self {
            passes: all.passes + sweep.passes,
            threads: all.threads.max(sweep.threads),
            secs: all.secs + sweep.secs,
            processor_secs: all.processor_secs + sweep.processor_secs,
            disk: all.disk + sweep.disk,
        })
    }

    /// Estimates a planned sweep with `passes` left.
    pub(crate) fn of(
        cost: Cost,
        plan: &SweepPlan,
        passes: usize,
        sensors: usize,
        study: &Study,
    ) -> Self {
        // Passes only train settings that have no run yet.
        let share = plan.runs_left as f64 / (plan.left * plan.candidates.len()).max(1) as f64;
        Self::new(cost.of_share(sensors, share), passes, plan.threads, plan.runs_left as u64, study)
    }

    fn new(pass_secs: f64, passes: usize, threads: usize, results: u64, study: &Study) -> Self {
        let rounds = passes.div_ceil(threads.max(1));
        Self {
            passes,
            threads: threads.min(passes.max(1)),
            secs: pass_secs * rounds as f64,
            processor_secs: pass_secs * passes as f64,
            disk: result_bytes(study, results),
        }
    }

    /// Returns the cost of the step, given its memory in bytes.
    pub(crate) fn of_step(&self, memory: u64) -> StepCost {
        StepCost { processor_secs: self.processor_secs, memory, disk: self.disk }
    }

    pub(crate) fn line(&self) -> String {
        format!(
            "expecting about {} on {} ({} passes over the data, {} of processor time); up to {} on disk",
            duration_of_secs(self.secs),
            counted(self.threads, "thread"),
            count(self.passes),
            duration_of_secs(self.processor_secs),
            bytes(self.disk)
        )
    }
}

/// Returns the bytes of this many results.
fn result_bytes(study: &Study, results: u64) -> u64 {
    results.saturating_mul(ROW_BYTES + POINT_BYTES * study.sweep.curve_points as u64)
}

/// Returns the bytes of this many runs, as far as they are certain. For a race it is not known how many are left out.
pub fn certain_bytes(study: &Study, runs: usize) -> u64 {
    match study.sweep.race {
        RaceKind::None => result_bytes(study, runs as u64),
        RaceKind::Halving => 0,
    }
}

/// Refuses runs if the disk has no room for their results in the `directory` of the sweep.
///
/// # Errors
/// Returns an error if there is clearly less room.
pub(crate) fn require_room(job: &Job, runs: usize, directory: &Path) -> Result<(), StepError> {
    let needed = certain_bytes(job.study(), runs);
    // With --force the existing results are removed first.
    let needed = if job.policy().redoes() { disk_room::left(needed, directory) } else { needed };
    disk_room::require(
        needed,
        "the sweep",
        directory,
        "choose a folder on another disk with --output, sweep fewer settings, or lower sweep.curve_points",
    )
}

/// Estimates a sweep whose earlier steps are still to do. Its cost is taken from replaying the log.
///
/// # Errors
/// Returns an error if the log cannot be read, or lacks what the study sweeps.
pub fn before_model(job: &Job, tally: &DryRunTally, context: &RunContext) -> Result<(), StepError> {
    let study = job.study();
    let candidates = candidates_of(study)?;
    let (parts, groups) = scorable(job, &candidates, &context.silent())?;
    let Ok(groups) = groups else { return Ok(()) };
    let span = StudyGroup::longest(&groups);
    let dataset = &parts.dataset;
    let sensors = model_files::sensor_columns(study, &dataset.normaliser, &dataset.profile)?;
    // Another log has other rows, and its states are no states of given agents.
    if context.stands_in().is_none() {
        let held_out = dataset.held_out.as_ref();
        if study.has_model() {
            starts::check(&study.sweep_starts(), &study.data, &dataset.train, held_out)?;
        }
        if study.pretrain.checkpoint.is_some() {
            let part = parts.pretrain.as_ref();
            pretrain_files::starts(job, dataset, part, &sensors, &candidates)?;
        }
    }
    let starts = BTreeMap::new();
    let trained = TrainedInPass {
        study,
        candidates: &groups[0].candidates,
        sensors: &sensors,
        starts: &starts,
        steps: span.steps,
    };
    let streams: Vec<Vec<String>> = groups.iter().map(|group| streams_of(job, group)).collect();
    let passes: usize = streams.iter().map(Vec::len).sum();
    let each = groups.iter().zip(&streams);
    let units: usize = each.map(|(group, streams)| group.sensors.len() * streams.len()).sum();
    let left = passes - tally.count_repeated(streams.into_iter().flatten());
    let sizes = Sizes::of(study, dataset, span, [units, passes]);
    let threads = rayon::current_num_threads();
    let memory = Memory::of(&sizes, &agents_of(&candidates), threads);
    // A substitute log is in memory itself.
    if context.stands_in().is_none() {
        memory.check()?;
    }
    let frames = &dataset.train;
    let states = span.states().min(frames.rows()).min(MEASURED_STEPS);
    let replayed = RowStream::looped(frames.states().clone(), frames.segments(), 0, states);
    let streamed = RunStream::complete(replayed, RowIndex::new(0));
    let progress = context.silent().progress();
    let cost = Cost::over(trained, &streamed, 0.0, tally.measured(), &progress)?;
    let results = (units * candidates.len()) as u64;
    let pass_secs = cost.of(sensors.len().div_ceil(groups.len()));
    let expected = Expected::new(pass_secs, left, threads, results, study);
    context.say(&expected.line());
    context.expect(StepKind::Sweep, job, expected.of_step(memory.total));
    tally.expect(job, expected);
    Ok(())
}

/// Returns names of the streams for a group's sensors. Models and deployments that share streams have the same names.
fn streams_of(job: &Job, group: &StudyGroup) -> Vec<String> {
    let study = job.study();
    let deployment = job.deployment().unwrap_or_default();
    let starts = if study.sweep_starts_follow_from_deployment() { deployment } else { "" };
    let model = job.model_name();
    let Streams { demand, online, log, .. } = &group.streams;
    let kinds = [
        (format!("online {deployment}"), online.as_ref().map_or(0, |_| study.sweep.online_runs)),
        ("log".to_owned(), log.starts.len()),
        (format!("members of {model} {starts}"), study.members() * study.member_runs()),
    ];
    let gamma = demand.gamma;
    kinds
        .into_iter()
        .flat_map(|(kind, runs)| (0..runs).map(move |run| format!("{kind} {run} {gamma}")))
        .collect()
}
