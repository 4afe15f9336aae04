//! How far rollouts are from what was recorded after the same start.

mod files;
mod measures;
mod pooled;
mod show;

use calib_core::Monitor as _;
use calib_dtw::{ByPattern, PatternSet, Settings, StepPattern};
use calib_rollout::Wanted;
use calib_stats::{Summary, summarise};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{
    model_files::OpenModel,
    trajectory::Trajectory,
    truth::{Record, Truth},
};
use crate::{cli::STEP_PATTERNS, exit::Interrupted, output::Printer};

pub(super) use files::{remove, write};
use measures::MEASURES;
pub(super) use pooled::pool;
pub(super) use show::{report_tables, show};

/// Fewest recorded steps that a rollout is compared with; with fewer it is left out.
const FEWEST_STEPS: usize = 20;

/// Everything that decides what is compared, beside the study: part of the fingerprint of rollouts.
pub(super) fn settings() -> impl Serialize {
    let measures = MEASURES.map(|measure| measure.column);
    (STEP_PATTERNS, measures, FEWEST_STEPS)
}

/// The comparison, in the manifest of the rollouts.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Comparison {
    /// Rollouts that were compared, of all members.
    pub(super) rollouts: usize,
    /// Rollouts that were left out, because what was recorded after their start ends too soon.
    pub(super) left_out: usize,
    /// Rollouts that were left out, because they ended (their next state would not have been finite) before the
    /// steps to compare did: distances over the few steps that are there would flatter the model.
    pub(super) ended_early: usize,
    /// Fewest and most steps that were compared; 0 if nothing was.
    pub(super) fewest_steps: usize,
    pub(super) most_steps: usize,
    /// Where the true trajectories were recorded.
    pub(super) against: Against,
    pub(super) sensors: Vec<SensorComparison>,
}

/// Where true trajectories were recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Against {
    /// In the data of the model, after the start state.
    Model,
    /// In the deployment, after the state that the start state stands for.
    Deployment,
}

/// Means over rollouts of all members, on the normalised sensor.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct SensorComparison {
    pub(super) sensor: String,
    pub(super) dtw: Vec<PatternSummary>,
    pub(super) measures: Vec<MeasureSummary>,
}

/// Dynamic time warping with one step pattern.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct PatternSummary {
    pub(super) step_pattern: String,
    pub(super) distance: Summary,
    pub(super) normalized_distance: Option<Summary>,
}

/// Another distance.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct MeasureSummary {
    /// Its column in `measures.parquet`.
    pub(super) measure: String,
    /// `None` if it is defined for no rollout.
    pub(super) value: Option<Summary>,
}

/// A rollout and what was recorded, on one sensor.
pub(super) struct Pair {
    member: usize,
    rollout: usize,
    sensor: usize,
    /// Steps that are compared.
    steps: usize,
    distances: ByPattern,
    /// In the order of [`MEASURES`]; `None` where a measure is not defined.
    measures: Vec<Option<f64>>,
}

/// All pairs, and their summary.
pub(super) struct Compared {
    pub(super) pairs: Vec<Pair>,
    pub(super) summary: Comparison,
}

/// A rollout that can be compared, and as many recorded states as it has comparable ones.
struct Job<'a> {
    member: usize,
    rollout: usize,
    trajectory: &'a Trajectory,
    recorded: Truth<'a>,
}

/// Compare the first `steps` steps of every rollout, or as many as were recorded, sensor by sensor.
pub(super) fn compare(
    model: &OpenModel,
    record: Record<'_>,
    all: &[Vec<Trajectory>],
    sensors: &[(String, usize)],
    steps: usize,
    printer: &Printer,
) -> anyhow::Result<Compared> {
    let set = PatternSet::new(step_patterns()?, Settings::default());
    let (jobs, ended_early) = jobs(record, all, steps);
    let pairs: Vec<(&Job<'_>, usize)> =
        jobs.iter().flat_map(|job| (0..sensors.len()).map(move |sensor| (job, sensor))).collect();
    let progress = printer.progress();
    progress.begin("comparing", pairs.len() as u64);
    let pairs = pairs
        .into_par_iter()
        .map(|(job, sensor)| {
            if progress.interrupted() {
                return Err(Interrupted.into());
            }
            let states = model.frames.states();
            let column = sensors[sensor].1;
            let reference: Vec<f64> = job.recorded.values(column).map(f64::from).collect();
            let query = job.trajectory.values(states, column, reference.len());
            let query: Vec<f64> = query.into_iter().map(f64::from).collect();
            let distances = set.distances(&query, &reference)?;
            let measures = MEASURES.iter().map(|measure| (measure.of)(&query, &reference));
            let measures = measures.collect::<anyhow::Result<_>>()?;
            progress.advance(1);
            let Job { member, rollout, .. } = *job;
            Ok(Pair { member, rollout, sensor, steps: query.len() - 1, distances, measures })
        })
        .collect::<anyhow::Result<Vec<_>>>()?;
    let rollouts: usize = all.iter().map(Vec::len).sum();
    let left_out = rollouts - jobs.len() - ended_early;
    let against = if all.iter().flatten().any(is_of_deployment) {
        Against::Deployment
    } else {
        Against::Model
    };
    let summary = summary(&pairs, sensors, jobs.len(), [left_out, ended_early], against)?;
    Ok(Compared { pairs, summary })
}

fn is_of_deployment(trajectory: &Trajectory) -> bool {
    matches!(trajectory.start().0, Wanted::Deployment(_))
}

fn step_patterns() -> anyhow::Result<Vec<StepPattern>> {
    STEP_PATTERNS.iter().map(|name| Ok(name.parse()?)).collect()
}

/// What is compared, and how many rollouts ended too early for that.
fn jobs<'a>(record: Record<'a>, all: &'a [Vec<Trajectory>], steps: usize) -> (Vec<Job<'a>>, usize) {
    let (mut jobs, mut ended_early) = (Vec::new(), 0);
    for (member, rollouts) in all.iter().enumerate() {
        for (number, rollout) in rollouts.iter().enumerate() {
            // The same stretch for every model, however far its own rollout gets.
            let recorded = record.after(rollout.start().0, steps);
            if recorded.len() <= FEWEST_STEPS.min(steps) {
                continue;
            }
            if rollout.steps() + 1 < recorded.len() {
                ended_early += 1;
            } else {
                jobs.push(Job { member, rollout: number, trajectory: rollout, recorded });
            }
        }
    }
    (jobs, ended_early)
}

fn summary(
    pairs: &[Pair],
    sensors: &[(String, usize)],
    rollouts: usize,
    [left_out, ended_early]: [usize; 2],
    against: Against,
) -> anyhow::Result<Comparison> {
    let steps = || pairs.iter().map(|pair| pair.steps);
    let of_sensor = |(sensor, (name, _)): (usize, &(String, usize))| {
        let own: Vec<&Pair> = pairs.iter().filter(|pair| pair.sensor == sensor).collect();
        sensor_summary(name, &own)
    };
    let sensors = if pairs.is_empty() { &[] } else { sensors };
    Ok(Comparison {
        rollouts,
        left_out,
        ended_early,
        fewest_steps: steps().min().unwrap_or(0),
        most_steps: steps().max().unwrap_or(0),
        against,
        sensors: sensors.iter().enumerate().map(of_sensor).collect::<anyhow::Result<_>>()?,
    })
}

fn sensor_summary(name: &str, pairs: &[&Pair]) -> anyhow::Result<SensorComparison> {
    let dtw = STEP_PATTERNS.iter().enumerate().map(|(number, pattern)| {
        // Series of equal length have a path in each of these patterns.
        let distances = pairs.iter().map(|pair| pair.distances[number].clone());
        let distances = distances.collect::<Result<Vec<_>, _>>()?;
        let raw: Vec<f64> = distances.iter().map(|distance| distance.raw).collect();
        let normalised: Option<Vec<f64>> =
            distances.iter().map(|distance| distance.normalised).collect();
        Ok(PatternSummary {
            step_pattern: (*pattern).to_owned(),
            distance: summarise(&raw)?,
            normalized_distance: normalised.map(|values| summarise(&values)).transpose()?,
        })
    });
    let measures = MEASURES.iter().enumerate().map(|(number, measure)| {
        let values: Vec<f64> = pairs.iter().filter_map(|pair| pair.measures[number]).collect();
        let value = if values.is_empty() { None } else { Some(summarise(&values)?) };
        Ok(MeasureSummary { measure: measure.column.to_owned(), value })
    });
    Ok(SensorComparison {
        sensor: name.to_owned(),
        dtw: dtw.collect::<anyhow::Result<_>>()?,
        measures: measures.collect::<anyhow::Result<_>>()?,
    })
}
