//! Distances between rollouts and the record after the same start state.

mod files;
mod measures;
mod pair;
mod paired;
mod show;
mod summary;
mod tables;

use calib_base::{StepError, output::Printer};
use calib_core::{Monitor as _, Timestamp};
use calib_dtw::{PatternSet, Settings, StepPattern};
use calib_model::{RequestedStart, Trajectory};
use calib_stats::ClusterSummary;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    STEP_PATTERNS,
    model::model_files::OpenModel,
    rollouts::truth::{Record, Truth, row},
};

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

/// The comparison, in the manifest of the rollouts.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Comparison {
    /// Rollouts that were compared, of all members.
    pub(crate) rollouts: usize,
    /// States that they were to start from. Members share them, so intervals are over these.
    pub(crate) start_states: usize,
    /// Those after which what was recorded shares steps with what was recorded after another: less independent than they
    /// are counted.
    pub(crate) overlapping: usize,
    /// Rollouts that were left out, because what was recorded after their start ends too soon.
    pub(crate) left_out: usize,
    /// Rollouts that were left out, because they ended (their next state would not have been finite) before the
    /// steps to compare did: distances over the few steps that are there would flatter the model.
    pub(crate) ended_early: usize,
    /// Fewest and most steps that were compared; 0 if nothing was.
    pub(crate) fewest_steps: usize,
    pub(crate) most_steps: usize,
    /// Where the true trajectories were recorded.
    pub(crate) against: Against,
    /// One entry for each sensor; empty if nothing was compared.
    pub sensors: Vec<SensorComparison>,
}

/// Where true trajectories were recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Against {
    /// In the data of the model, after the start state.
    Model,
    /// In the deployment, after the state that the start state stands for.
    Deployment,
}

/// Means over start states of the means over members, on the normalised sensor.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct SensorComparison {
    /// What it is called.
    pub sensor: String,
    /// One entry for each of [`STEP_PATTERNS`].
    pub dtw: Vec<PatternSummary>,
    pub(crate) measures: Vec<MeasureSummary>,
}

/// Dynamic time warping with one step pattern.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct PatternSummary {
    pub(crate) step_pattern: String,
    /// Weighted sum of the local distances along the warping path.
    pub distance: ClusterSummary,
    /// The same, normalised as the pattern says; `None` if it does not.
    pub normalized_distance: Option<ClusterSummary>,
}

/// Another distance.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub(crate) struct MeasureSummary {
    /// Its column in `measures.parquet`.
    pub(crate) measure: String,
    /// `None` if it is defined for no rollout.
    pub(crate) value: Option<ClusterSummary>,
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
