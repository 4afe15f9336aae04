//! Passes that an accelerator trains side by side. Such a group of passes is a cohort.

use std::collections::BTreeMap;

use calib_agent::{Accelerator, AgentError, Run, runs_together, train_together};
use calib_core::Monitor;
use rayon::prelude::*;

use crate::{RunStream, SettingRun, SweepError, UnitRuns, UnitSink, pass::Pass};

/// Runs these passes, as many side by side as the accelerator can hold. Results are in the order of the passes. The
/// results of a cohort are stored when the whole cohort is done.
pub(crate) fn run(
    passes: &[Pass<'_, '_>],
    accelerator: &dyn Accelerator,
    sink: &dyn UnitSink,
    monitor: &dyn Monitor,
) -> Result<Vec<UnitRuns>, SweepError> {
    // Only networks of the same learners can be stacked.
    let mut alike: BTreeMap<Vec<(usize, Vec<usize>)>, Vec<usize>> = BTreeMap::new();
    for (number, pass) in passes.iter().enumerate() {
        let learners = pass.jobs.iter().map(|job| {
            (job.column, job.agents.iter().map(|candidate| candidate.index).collect::<Vec<_>>())
        });
        alike.entry(learners.collect()).or_default().push(number);
    }
    let mut results: Vec<Vec<UnitRuns>> = vec![Vec::new(); passes.len()];
    for group in alike.values() {
        let first = &passes[group[0]];
        let size = (first.options.span.states(), first.stream()?.stream.width());
        let most = runs_together(accelerator, &first.learners(), size);
        for now in group.chunks(most) {
            monitor.check()?;
            let cohort: Vec<&Pass<'_, '_>> = now.iter().map(|&number| &passes[number]).collect();
            let made = together(&cohort, accelerator, sink, monitor)?;
            for (&number, made) in now.iter().zip(made) {
                results[number] = made;
            }
        }
    }
    Ok(results.into_iter().flatten().collect())
}

/// Runs passes of the same learners side by side.
fn together(
    passes: &[&Pass<'_, '_>],
    accelerator: &dyn Accelerator,
    sink: &dyn UnitSink,
    monitor: &dyn Monitor,
) -> Result<Vec<Vec<UnitRuns>>, SweepError> {
    let streams = passes.par_iter().map(|pass| pass.stream());
    let streams: Vec<RunStream> = streams.collect::<Result<_, _>>()?;
    let both = passes.iter().zip(&streams);
    let runs: Vec<Run<'_>> = both
        .clone()
        .filter(|(_, streamed)| streamed.not_finite.is_none())
        .map(|(pass, streamed)| pass.agent_run(&*streamed.stream))
        .collect();
    let made =
        train_together(&runs, &passes[0].learners(), accelerator, monitor).map_err(failed)?;
    let mut made = made.into_iter();
    both.map(|(pass, streamed)| match streamed.not_finite {
        Some(_) => {
            monitor.advance(pass.options.span.steps as u64);
            pass.put(sink, streamed, SettingRun::failed)
        }
        None => pass.put_outcomes(sink, streamed, made.next().unwrap_or_default()),
    })
    .collect()
}

/// Converts the error that ended the training of a cohort.
fn failed(source: AgentError) -> SweepError {
    match source {
        AgentError::Cancelled(cancelled) => cancelled.into(),
        source => SweepError::Together(source),
    }
}
