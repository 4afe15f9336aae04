//! The step that makes rollouts of a model, and compares them with the record.

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use calib_base::{
    StepError,
    artefact::{self, Artefact, DirectoryLock, Facts},
    clock::Stopwatch,
    log::{context::RunContext, partition},
    memory,
    outcome::{Freshness, NoPlan, Outcome, StepResult},
    output::{Printer, bytes, count, counted},
};
use calib_core::{Frames, Normalised, RowIndex, Timestamp};
use calib_data::table::Table;
use calib_files::Fingerprint;
use calib_model::{JumpStatistics, Rolling, RolloutConfig, Search, Trajectory};
use calib_study::{Job, StepKind, Study};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    model::{
        kinds::search_place,
        model_files::{self, OpenModel},
        starts::{self, StartSummary, Starts, summaries},
    },
    rollouts::{
        collapse::{self, Collapse},
        comparison::{self, Comparison},
        cost::{self, RolloutSize},
        figures,
        one_step::{self, OneStep},
        trajectory_columns::Columns,
        truth::{self, Record},
    },
};

/// `manifest.json` of a rollout directory.
pub type RolloutManifest = Artefact<RolloutFacts>;

/// Description of rollouts in their manifest.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub struct RolloutFacts {
    pub(crate) key: String,
    /// Fingerprint of the content of the model.
    pub model: String,
    /// The study that the rollouts were made with.
    #[schemars(with = "calib_base::resolved::ResolvedStudy")]
    pub study: Study,
    /// Sensors whose trajectories are written.
    pub sensors: Vec<String>,
    /// Time from one state to the next, in seconds.
    pub period_secs: f64,
    /// One entry for each ensemble member.
    pub members: Vec<MemberRollouts>,
    /// Rollouts that freeze or end early.
    pub collapse: Collapse,
    /// Distances from the recorded trajectories after the same start states; none if the comparison is switched off.
    pub comparison: Option<Comparison>,
}

/// Statistics of the rollouts of one ensemble member.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub struct MemberRollouts {
    /// Number of transitions of the ensemble member.
    pub(crate) transitions: usize,
    /// Jumps of the rollouts; none for models that leave the data.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) jumps: Option<JumpStatistics>,
    /// Start states that the ensemble member lacks, and the distances of their replacements.
    pub starts: StartSummary,
}

impl Facts for RolloutFacts {
    const FORMAT: u32 = 7;
    const STEP: StepKind = StepKind::Rollout;

    fn key(&self) -> &str {
        &self.key
    }
}

/// Reads the rollouts of `model` if they were made by this study. `None` if they were not made, or are of another
/// deployment, or there is no model.
///
/// # Errors
/// If a table has changed since it was written.
pub fn finished(job: &Job, model: Option<&str>) -> Result<Option<RolloutManifest>, StepError> {
    let Some(model) = model else { return Ok(None) };
    let paths = job.layout();
    let found = artefact::read::<RolloutManifest>(&paths.rollout()).filter(|found| {
        found.model == *model && job.study().differences(StepKind::Rollout, &found.study).is_empty()
    });
    if let Some(found) = &found {
        artefact::check_files(&paths.rollout(), &found.files, &job.command(StepKind::Rollout))?;
    }
    Ok(found)
}

/// Rollouts of the model of a study.
#[derive(Debug)]
pub struct Rollouts {
    pub(crate) manifest: RolloutManifest,
    /// One-step errors of the model, if there is a held-out period and the model can predict.
    pub(crate) one_step: Option<OneStep>,
    pub(crate) directory: PathBuf,
    pub(crate) freshness: Freshness,
    pub(crate) took: Duration,
}

impl Rollouts {
    /// Returns the sensors whose trajectories are written.
    pub fn sensors(&self) -> &[String] {
        &self.manifest.sensors
    }

    /// Returns the number of members of the model. Each has rollouts.
    pub fn members(&self) -> usize {
        self.manifest.members.len()
    }

    /// Returns whether they existed already.
    pub fn freshness(&self) -> Freshness {
        self.freshness
    }

    /// Returns their directory.
    pub fn directory(&self) -> &Path {
        &self.directory
    }
}

/// Makes rollouts of every member, and compares the trajectories with the record.
///
/// # Errors
/// If the model does not exist or is not of this study, the deployment cannot be read, or the observer asks to stop.
pub fn run(job: &Job, context: &RunContext) -> Result<StepResult<Rollouts>, StepError> {
    let clock = Stopwatch::start();
    let study = job.study();
    let paths = job.layout();
    let model = model_files::open(job)?;
    let sensors = sensors(study, &model, &paths.model())?;
    let directory = paths.rollout();
    let deployment = match held_out(job, &model, context) {
        Err(reason) if job.deployment().is_some() && partition::is_outside(&reason) => {
            let name = job.deployment().unwrap_or_default();
            context.error(&format!("deployment {name} is left out: {reason}"));
            return Ok(StepResult::Nothing(Outcome::Negative));
        }
        deployment => deployment?,
    };
    let seed = study.seed_of_rollouts();
    let (held_out, fingerprint) = deployment
        .as_ref()
        .filter(|_| study.starts_follow_from_deployment())
        .map(|(frames, fingerprint)| (frames, fingerprint))
        .unzip();
    let starts = Starts::new(&study.rollout, &study.data, &model, held_out, seed)?;
    let inputs = (
        RolloutFacts::FORMAT,
        starts.origin(fingerprint)?,
        model_files::content(&model.manifest)?,
        study.model.of_any_index().config,
        &study.rollout,
        study.seed,
        &sensors,
        comparison::settings(),
    );
    let key = match study.rollout_noise_inputs() {
        Some(noise) => artefact::key(&(inputs, noise))?,
        None => artefact::key(&inputs)?,
    };
    let size = RolloutSize::of(study, &*model.model, sensors.len());
    announce(study, &model, size.memory(), context);
    if job.policy().is_dry() {
        starts::check(&study.rollout, &study.data, &model.frames, held_out)?;
        if job.policy().redoes() || RolloutManifest::find(&directory, &key).is_none() {
            cost::expect(job, &model, size, context)?;
        }
        context.say(&format!("dry run: nothing written to {}", directory.display()));
        return Ok(StepResult::Planned(NoPlan));
    }
    let existing = RolloutManifest::of_job(job, &key, context)?;
    let (manifest, freshness) = if let Some(manifest) = existing {
        (manifest, Freshness::Kept)
    } else {
        let remedy = "lower rollout.steps or rollout.rollouts, or name fewer sweep.sensors";
        memory::require(size.memory(), "the rollouts", remedy)?;
        let record = Record { model: &model.frames, deployment: held_out };
        let from = (&starts, record);
        let made = roll_out(study, &model, from, &sensors, key, &directory, context)?;
        (made, Freshness::Made)
    };
    let one_step = match deployment.as_ref().filter(|_| study.rollout.dtw_steps > 0) {
        Some(held_out) => one_step::ensure(job, &model, held_out, &sensors, context)?,
        None => None,
    };
    if one_step.is_none() {
        one_step::remove(paths)?;
    }
    let took = clock.elapsed();
    Ok(StepResult::Made(Rollouts { manifest, one_step, directory, freshness, took }))
}

/// Checks the start states of rollouts whose model is still to be built, as far as they follow from the log, and
/// reports the expected cost.
///
/// # Errors
/// If the log lacks them, or cannot be read.
pub fn before_model(job: &Job, context: &RunContext) -> Result<(), StepError> {
    let study = job.study();
    let log = if context.stands_in().is_some() { job.before_deployment()? } else { job.clone() };
    let dataset = match partition::load(&log, &context.silent()) {
        // The step itself tells that the deployment is left out.
        Err(reason) if job.deployment().is_some() && partition::is_outside(&reason) => {
            return Ok(());
        }
        parts => parts?.dataset,
    };
    // A stand-in has other rows than the log.
    if context.stands_in().is_none() {
        starts::check(&study.rollout, &study.data, &dataset.train, dataset.held_out.as_ref())?;
    }
    let sensors = match study.sweep.sensors.len() {
        0 => dataset.train.states().columns(),
        sensors => sensors,
    };
    cost::expect_before_model(job, &dataset.train, sensors, context)
}

/// Returns the sensors of the sweep, or all, with their columns.
fn sensors(
    study: &Study,
    model: &OpenModel,
    directory: &Path,
) -> Result<Vec<(String, usize)>, StepError> {
    let normaliser = &model.manifest.normaliser;
    if study.sweep.sensors.is_empty() {
        let columns = normaliser.columns().iter().enumerate();
        return Ok(columns.map(|(column, known)| (known.name.clone(), column)).collect());
    }
    model_files::sensor_columns(study, normaliser, &model_files::read_profile(directory)?)
}

/// Reports the rollouts that begin, and the bytes that they take.
fn announce(study: &Study, model: &OpenModel, needed: u64, printer: &Printer) {
    let RolloutConfig { steps, rollouts, .. } = study.rollout;
    printer.say(&format!(
        "rollout: {} x {} of {} steps; about {} of memory",
        counted(model.model.members(), "ensemble member"),
        counted(rollouts, "rollout"),
        count(steps),
        bytes(needed),
    ));
}

fn roll_out(
    study: &Study,
    model: &OpenModel,
    (starts, record): (&Starts<'_>, Record<'_>),
    sensors: &[(String, usize)],
    key: String,
    directory: &Path,
    printer: &Printer,
) -> Result<RolloutManifest, StepError> {
    let claim = DirectoryLock::begun(directory)?;
    let config = &study.rollout;
    let progress = printer.progress();
    let place = search_place(&*model.model, directory);
    let search = Search { place: &place, monitor: &progress };
    let given = starts.of_members(config.rollouts, search)?;
    let seed = study.seed_of_rollouts();
    let rolling = Rolling { steps: config.steps, weights: study.model.weights()?, seed };
    let all: Vec<Vec<Trajectory>> = given
        .iter()
        .enumerate()
        .map(|(member, starts)| model.model.roll_out(member, starts, &rolling, &progress))
        .collect::<Result<_, _>>()?;
    drop(progress);
    let trajectories = artefact::marked(trajectories(model, record, &all, sensors));
    trajectories.write_parquet(&directory.join("trajectories.parquet"))?;
    let names: Vec<String> = sensors.iter().map(|(name, _)| name.clone()).collect();
    let period_secs = model.manifest.period.as_secs();
    let mut files = vec!["trajectories.parquet".to_owned()];
    let rollouts = figures::rollouts(&trajectories, &names, period_secs)?;
    let placed = figures::placed(rollouts.iter().map(|grid| grid.sensor.as_str()));
    for (figure, name) in rollouts.iter().zip(placed) {
        let drawn = figures::write(&directory.join("figures"), &name, &figure.figure()?)?;
        files.extend(drawn.map(|name| format!("figures/{name}")));
    }
    let collapse = collapse::of(model, record, &all, sensors)?;
    let steps = config.dtw_steps.min(config.steps);
    let comparison = compare(model, record, &all, sensors, directory, steps, printer)?;
    let starts = summaries(
        &all.iter()
            .map(|rollouts| rollouts.iter().map(Trajectory::start).collect())
            .collect::<Vec<_>>(),
    );
    let members = all.iter().zip(starts).enumerate();
    let members = members
        .map(|(member, (rollouts, starts))| MemberRollouts {
            transitions: model.manifest.members[member].transitions,
            jumps: jumps_of(rollouts),
            starts,
        })
        .collect();
    let compared = comparison.is_some().then_some(comparison::FILES);
    files.extend(compared.into_iter().flatten().map(str::to_owned));
    let facts = RolloutFacts {
        key,
        model: model_files::content(&model.manifest)?,
        study: study.clone(),
        sensors: names,
        period_secs,
        members,
        collapse,
        comparison,
    };
    claim.finish(facts, files.iter().map(String::as_str))
}

fn jumps_of(rollouts: &[Trajectory]) -> Option<JumpStatistics> {
    let rows: Option<Vec<&[RowIndex]>> = rollouts.iter().map(Trajectory::rows).collect();
    rows.map(JumpStatistics::of)
}

/// Compares the rollouts with the record, and writes the tables; nothing for 0 steps.
fn compare(
    model: &OpenModel,
    record: Record<'_>,
    all: &[Vec<Trajectory>],
    sensors: &[(String, usize)],
    directory: &Path,
    steps: usize,
    printer: &Printer,
) -> Result<Option<Comparison>, StepError> {
    if steps == 0 {
        comparison::remove(directory)?;
        return Ok(None);
    }
    let compared = comparison::compare(model, record, all, sensors, steps, printer)?;
    comparison::write(directory, &compared.pairs)?;
    Ok(Some(compared.summary))
}

/// Returns the held-out range, if start states depend on it or one-step errors are requested. The record before it is
/// read, and dropped.
fn held_out(
    job: &Job,
    model: &OpenModel,
    context: &RunContext,
) -> Result<Option<(Frames, Fingerprint)>, StepError> {
    let study = job.study();
    let paths = job.layout();
    // A model that deployments share was built without the held-out period of one of them.
    let is_held_out = study.data.held_out.is_some()
        || model_files::read_profile(&paths.model())?.held_out.is_some();
    let is_in_place = job.reads_the_log_of(&model.manifest.study);
    let is_used = is_held_out && study.rollout.dtw_steps > 0;
    if !study.starts_follow_from_deployment() && !is_used && is_in_place {
        return Ok(None);
    }
    let dataset = partition::load(job, context)?.dataset;
    model_files::check_data(job, &model.manifest, &dataset)?;
    Ok(dataset.held_out.zip(dataset.held_out_fingerprint))
}

/// Returns a table with one row per step: member, rollout, step, the recorded row and its time, the row that was
/// requested as the start. Per sensor it has the value in physical and in normalised units, and the recorded trajectory
/// from the requested row. Predictions have a row and a time only at their start.
fn trajectories(
    model: &OpenModel,
    record: Record<'_>,
    all: &[Vec<Trajectory>],
    sensors: &[(String, usize)],
) -> Table {
    let mut visited: Vec<Option<RowIndex>> = Vec::new();
    let mut wanted = Vec::new();
    let mut wanted_times = Vec::new();
    let mut members = Vec::new();
    let mut numbers = Vec::new();
    let mut steps = Vec::new();
    for (member, rollouts) in all.iter().enumerate() {
        for (number, rollout) in rollouts.iter().enumerate() {
            for step in 0..=rollout.steps() {
                members.push(member as u32);
                numbers.push(number as u32);
                steps.push(step as u32);
                visited.push(rollout.row(step));
                wanted.push(truth::row(rollout.start().0).0);
                wanted_times.push(record.time(rollout.start().0));
            }
        }
    }
    let times = model.frames.timestamps();
    let timestamps: Vec<Option<Timestamp>> =
        visited.iter().map(|row| row.map(|row| times[row.get()])).collect();
    let states = model.frames.states();
    let mut table = Table::new()
        .with("member", members)
        .with("rollout", numbers)
        .with("step", steps)
        .with_optional("row", visited.iter().map(|row| row.map(|row| row.0)).collect())
        .with_optional("timestamp", timestamps)
        .with("wanted_row", wanted)
        .with_optional("wanted_timestamp", wanted_times);
    let names: Vec<&str> = sensors.iter().map(|(name, _)| name.as_str()).collect();
    for ((_, column), named) in sensors.iter().zip(Columns::of(&names)) {
        let normalised: Vec<f32> = all
            .iter()
            .flatten()
            .flat_map(|rollout| rollout.values(states, *column, rollout.steps() + 1))
            .collect();
        let physical =
            |value: f32| model.manifest.normaliser.physical(*column, Normalised(value)).0;
        table = table
            .with(named.physical, normalised.iter().copied().map(physical).collect::<Vec<f64>>())
            .with(named.normalised, normalised)
            .with_optional(
                named.recorded,
                all.iter()
                    .flatten()
                    .flat_map(|rollout: &Trajectory| {
                        let truth = record.after(rollout.start().0, rollout.steps());
                        let known: Vec<Option<f64>> =
                            truth.values(*column).map(|value| Some(physical(value))).collect();
                        let unknown = rollout.steps() + 1 - known.len();
                        known.into_iter().chain(std::iter::repeat_n(None, unknown))
                    })
                    .collect::<Vec<Option<f64>>>(),
            );
    }
    table
}
