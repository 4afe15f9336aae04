//! Passes that an accelerator makes side by side.

use std::collections::BTreeMap;

use calib_agent::{Accelerator, Run, runs_together, train_together};
use calib_core::Monitor;
use rayon::prelude::*;

use crate::{RunRow, RunStream, SweepError, UnitResult, UnitSink, pass::Pass};

/// Make these passes, as many side by side as the accelerator can; results come in the order of the passes.
///
/// `all` is the number of passes of the plan. Whatever is missing of it, as many are made side by side, if need be with copies that nobody looks at: products
/// are made in another order where there are more or fewer of them, and the results of a sweep that was interrupted are those of one that was not.
pub(crate) fn run(
    passes: &[Pass<'_, '_>],
    all: usize,
    accelerator: &dyn Accelerator,
    sink: &dyn UnitSink,
    monitor: &dyn Monitor,
) -> Result<Vec<UnitResult>, SweepError> {
    // Networks are stacked where they are of the same learners.
    let mut alike: BTreeMap<Vec<(usize, Vec<usize>)>, Vec<usize>> = BTreeMap::new();
    for (number, pass) in passes.iter().enumerate() {
        let learners = pass.jobs.iter().map(|job| {
            (job.column, job.agents.iter().map(|candidate| candidate.index).collect::<Vec<_>>())
        });
        alike.entry(learners.collect()).or_default().push(number);
    }
    let mut results: Vec<Vec<UnitResult>> = vec![Vec::new(); passes.len()];
    for group in alike.values() {
        let first = &passes[group[0]];
        let size = (first.options.span.states(), first.stream()?.stream.width());
        let places = runs_together(accelerator, &first.learners(), size, all);
        for now in group.chunks(places) {
            if monitor.interrupted() {
                return Err(SweepError::Interrupted);
            }
            let cohort: Vec<&Pass<'_, '_>> = now.iter().map(|&number| &passes[number]).collect();
            let made = together(&cohort, places, accelerator, sink, monitor)?;
            for (&number, made) in now.iter().zip(made) {
                results[number] = made;
            }
        }
    }
    Ok(results.into_iter().flatten().collect())
}

/// Make passes of the same learners side by side, `places` of them.
fn together(
    passes: &[&Pass<'_, '_>],
    places: usize,
    accelerator: &dyn Accelerator,
    sink: &dyn UnitSink,
    monitor: &dyn Monitor,
) -> Result<Vec<Vec<UnitResult>>, SweepError> {
    let streams = passes.par_iter().map(|pass| pass.stream());
    let streams: Vec<RunStream> = streams.collect::<Result<_, _>>()?;
    let both = || passes.iter().zip(&streams);
    let runs: Vec<Run<'_>> = both()
        .filter(|(_, streamed)| streamed.not_finite.is_none())
        .map(|(pass, streamed)| pass.agent_run(&*streamed.stream))
        .collect();
    let made = train_together(&runs, &passes[0].learners(), places, accelerator, monitor)
        .map_err(|source| passes[0].failed(source))?;
    let mut made = made.into_iter();
    both()
        .map(|(pass, streamed)| match streamed.not_finite {
            Some(_) => {
                monitor.advance(pass.options.span.steps as u64);
                pass.put(sink, streamed, RunRow::failed)
            }
            None => pass.put_outcomes(sink, streamed, made.next().unwrap_or_default()),
        })
        .collect()
}
