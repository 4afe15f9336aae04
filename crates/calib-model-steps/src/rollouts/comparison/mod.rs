//! Distances between rollouts and the record after the same start state.

mod facts;
mod files;
mod measures;
mod pair;
mod paired;
mod show;
mod summary;
mod tables;

use calib_base::{StepError, clock::TimeTaken, output::Printer};
use calib_core::{Monitor as _, Timestamp};
use calib_dtw::{PatternSet, Settings, StepPattern};
use calib_model::{RequestedStart, Trajectory};
use rayon::prelude::*;
use serde::Serialize;

use crate::{
    STEP_PATTERNS,
    model::model_files::OpenModel,
    rollouts::truth::{Record, Truth, row},
};

use facts::Against;
pub use facts::{Comparison, PatternSummary, SensorComparison};
pub use files::read;
pub(crate) use files::{FILES, remove, write};
use measures::MEASURES;
pub use pair::Pair;
pub use paired::{ComparedModel, PairedModels, all_pairs};
pub(crate) use show::show;
pub use show::show_pairs;
pub use summary::pool;
use summary::{Counts, summary};
pub use tables::report_tables;

/// Minimum number of recorded steps for a comparison. A rollout with fewer is left out.
const FEWEST_STEPS: usize = 20;

/// Returns all settings of the comparison besides the study. They are a part of the fingerprint of rollouts.
pub(crate) fn settings() -> impl Serialize {
    let measures = MEASURES.map(|measure| measure.column);
    (STEP_PATTERNS, measures, FEWEST_STEPS)
}

/// All pairs, and their summary.
pub(crate) struct ComparedPairs {
    pub(crate) pairs: Vec<Pair>,
    pub(crate) summary: Comparison,
}

/// A rollout that can be compared, and as many recorded states as it has comparable ones.
struct ComparisonJob<'a> {
    member: usize,
    rollout: usize,
    wanted: RequestedStart,
    start: Timestamp,
    trajectory: &'a Trajectory,
    recorded: Truth<'a>,
}

/// Compares the first `steps` steps of every rollout, or as many as were recorded, sensor by sensor.
pub(crate) fn compare(
    model: &OpenModel,
    record: Record<'_>,
    all: &[Vec<Trajectory>],
    sensors: &[(String, usize)],
    steps: usize,
    printer: &Printer,
) -> Result<ComparedPairs, StepError> {
    let set = PatternSet::new(step_patterns()?, Settings::default());
    let (jobs, ended_early) = jobs(record, all, steps);
    let pairs: Vec<(&ComparisonJob<'_>, usize)> =
        jobs.iter().flat_map(|job| (0..sensors.len()).map(move |sensor| (job, sensor))).collect();
    let progress = printer.progress();
    progress.begin("comparing", pairs.len() as u64);
    let pairs = pairs
        .into_par_iter()
        .map(|(job, sensor)| {
            progress.check()?;
            let states = model.frames.states();
            let column = sensors[sensor].1;
            let reference: Vec<f64> = job.recorded.values(column).map(f64::from).collect();
            let query = job.trajectory.values(states, column, reference.len());
            let query: Vec<f64> = query.into_iter().map(f64::from).collect();
            let warping = set.distances(&query, &reference)?.into_iter();
            let warping =
                warping.map(|warped| warped.map(|distance| (distance.raw, distance.normalised)));
            let measures = MEASURES.iter().map(|measure| (measure.distance)(&query, &reference));
            let pair = Pair {
                member: job.member as u32,
                rollout: job.rollout as u32,
                wanted: row(job.wanted).0,
                start: job.start,
                sensor: sensors[sensor].0.clone(),
                steps: query.len() as u32 - 1,
                // Series of equal length have a path in each of these patterns.
                warping: warping.collect::<Result<_, _>>()?,
                measures: measures.collect::<Result<_, StepError>>()?,
            };
            progress.advance(1);
            Ok(pair)
        })
        .collect::<Result<Vec<_>, StepError>>()?;
    let rollouts: usize = all.iter().map(Vec::len).sum();
    let left_out = rollouts - jobs.len() - ended_early;
    let against = if all.iter().flatten().any(is_of_deployment) {
        Against::Deployment
    } else {
        Against::Model
    };
    let counts = Counts { rollouts: jobs.len(), left_out, ended_early };
    let summary = summary(&pairs, counts, against)?;
    Ok(ComparedPairs { pairs, summary })
}

/// Number of states of the series that are timed.
const TIMED_STATES: usize = 1_000;

/// Returns the seconds to compare `steps` steps of one rollout with the record on one sensor. They are measured with
/// shorter series.
pub(super) fn secs_of_pair(steps: usize) -> Result<f64, StepError> {
    let set = PatternSet::new(step_patterns()?, Settings::default());
    let states = steps + 1;
    let timed = states.clamp(FEWEST_STEPS + 1, TIMED_STATES);
    let [query, reference] = [0.0, 1.0].map(|phase: f64| -> Vec<f64> {
        (0..timed).map(|state| (0.1 * state as f64 + phase).sin()).collect()
    });
    let (compared, taken) = TimeTaken::by(|| -> Result<(), StepError> {
        set.distances(&query, &reference)?;
        MEASURES.iter().try_for_each(|measure| (measure.distance)(&query, &reference).map(drop))
    });
    compared?;
    // Warping compares every state with every other.
    Ok(taken.secs * (states as f64 / timed as f64).powi(2))
}

fn is_of_deployment(trajectory: &Trajectory) -> bool {
    matches!(trajectory.start().0, RequestedStart::Deployment(_))
}

fn step_patterns() -> Result<Vec<StepPattern>, StepError> {
    STEP_PATTERNS.iter().map(|name| Ok(name.parse()?)).collect()
}

/// Returns the rollouts to compare, and how many of them ended too early for that.
fn jobs<'a>(
    record: Record<'a>,
    all: &'a [Vec<Trajectory>],
    steps: usize,
) -> (Vec<ComparisonJob<'a>>, usize) {
    let mut jobs = Vec::new();
    let mut ended_early = 0;
    for (member, rollouts) in all.iter().enumerate() {
        for (number, rollout) in rollouts.iter().enumerate() {
            // Every model is compared with the same stretch, however far its own rollout gets.
            let wanted = rollout.start().0;
            let recorded = record.after(wanted, steps);
            let Some(start) = record.time(wanted) else { continue };
            if recorded.len() <= FEWEST_STEPS.min(steps) {
                continue;
            }
            if rollout.steps() + 1 < recorded.len() {
                ended_early += 1;
                continue;
            }
            let trajectory = rollout;
            jobs.push(ComparisonJob {
                member,
                rollout: number,
                wanted,
                start,
                trajectory,
                recorded,
            });
        }
    }
    (jobs, ended_early)
}
