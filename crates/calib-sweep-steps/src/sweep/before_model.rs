//! The estimate of a sweep whose earlier steps are still to do.

use std::collections::BTreeMap;

use calib_base::{StepError, log::context::RunContext};
use calib_core::{RowIndex, RowStream};
use calib_model_steps::model::{model_files, starts};
use calib_study::{Job, StepKind};
use calib_sweep::RunStream;

use crate::{
    agents::pretrain_files,
    sweep::{
        candidates::candidates_of,
        cost::{Cost, MEASURED_STEPS, TrainedInPass},
        expected::Expected,
        groups::StudyGroup,
        memory::{Memory, Sizes, agents_of},
        plan::DryRunTally,
        setting::scorable,
        streams::Streams,
    },
};

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
