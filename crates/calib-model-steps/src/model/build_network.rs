//! `build-model` for a model that is a network.

use std::path::Path;

use calib_base::{
    StepError,
    artefact::{self, DirectoryLock},
    bail,
    clock::Stopwatch,
    log::{context::RunContext, partition},
    options::BuildOptions,
    outcome::{Freshness, Outcome, StepResult},
    output::Printer,
};
use calib_core::Transitions;
use calib_data::Dataset;
use calib_files::write_json;
use calib_model::ModelKind;
use calib_study::{Job, StepKind};
use serde::Serialize;

use crate::model::{
    build_plan::BuildPlan,
    built_model::BuiltModel,
    model_files::{self, MemberSummary, ModelFacts, ModelManifest},
    train_model,
};

/// Trains the network of a study.
pub(crate) fn run(
    job: &Job,
    options: &BuildOptions,
    context: &RunContext,
) -> Result<StepResult<BuiltModel, Option<BuildPlan>>, StepError> {
    let clock = Stopwatch::start();
    let study = job.study();
    let directory = job.layout().model();
    // A calib that cannot train the network can still use one that another
    // calib has trained.
    let may_be_there = options.device.is_none()
        && !job.policy().redoes()
        && artefact::read::<ModelManifest>(&directory)
            .is_some_and(|there| there.study.model.kind == study.model.kind);
    let mut cannot_train = train_model::check_available(study, options.device).err();
    if let Some(reason) = cannot_train.take_if(|_| !may_be_there) {
        return Err(reason);
    }
    if options.verify > 0 {
        bail!("--verify compares neighbour tables, and model.kind is not \"knn\"; leave it out");
    }
    let partition::Parts { dataset, states, .. } = partition::load(job, context)?;
    model_files::sensor_columns(study, &dataset.normaliser, &dataset.profile)?;
    let key = train_model::key(&dataset.fingerprint, job)?;
    train_model::announce(study, &dataset, context);
    if job.policy().is_dry() {
        // The time of another arithmetic is not known.
        if options.device.is_none()
            && !model_files::is_kept(job, &dataset)
            && let Some(cost) = train_model::cost(study, &dataset, &context.silent().progress())?
        {
            context.tell_cost(StepKind::BuildModel, job, cost);
        }
        context.say(&format!("dry run: nothing written to {}", directory.display()));
        return Ok(StepResult::Planned(None));
    }
    let existing = ModelManifest::of_job(job, &key, context)?;
    let freshness = if existing.is_some() { Freshness::Kept } else { Freshness::Made };
    let manifest = match (existing, cannot_train) {
        (Some(manifest), _)
            if manifest.study == *study && model_files::has_profile(&manifest, &directory) =>
        {
            manifest
        }
        // The study may differ in keys that do not affect the weights.
        (Some(manifest), _) => model_files::rewrite(manifest, study, &dataset, &directory)?,
        (None, Some(reason)) => return Err(reason),
        (None, None) => build(job, options, &dataset, states.as_deref(), key, clock, context)?,
    };
    let took = clock.elapsed();
    let verified = Outcome::Done;
    Ok(StepResult::Made(BuiltModel { manifest, directory, freshness, took, verified }))
}

fn build(
    job: &Job,
    options: &BuildOptions,
    dataset: &Dataset,
    states: Option<&Path>,
    key: String,
    clock: Stopwatch,
    printer: &Printer,
) -> Result<ModelManifest, StepError> {
    let study = job.study();
    let directory = &job.layout().model();
    let claim = DirectoryLock::begun(directory)?;
    if job.policy().redoes() {
        train_model::remove_checkpoint(directory)?;
    }
    let read = clock.elapsed();
    let training = if study.model.kind == ModelKind::Torchscript {
        train_model::import(job, dataset, directory)?;
        None
    } else {
        Some(train_model::train(study, dataset, &key, directory, options.device, printer)?)
    };
    let trained = clock.elapsed();
    model_files::write_states(directory, &dataset.train, states)?;
    model_files::write(directory, dataset, None)?;
    let transitions = Transitions::new(dataset.train.segments().clone()).len();
    let members = vec![MemberSummary { transitions, jumps: None, recurrence: None }];
    let facts =
        ModelFacts { training, ..ModelFacts::of(key, study, dataset, transitions, members) };
    let timings = Timings {
        reading_secs: read.as_secs_f64(),
        training_secs: trained.saturating_sub(read).as_secs_f64(),
        writing_secs: clock.elapsed().saturating_sub(trained).as_secs_f64(),
    };
    write_json(&directory.join("timings.json"), &timings)?;
    let files = model_files::file_names(0, train_model::files(study.model.kind));
    claim.finish(facts, files.iter().map(String::as_str))
}

/// Wall times.
#[derive(Serialize)]
#[expect(clippy::struct_field_names, reason = "every number carries its unit")]
struct Timings {
    reading_secs: f64,
    training_secs: f64,
    writing_secs: f64,
}
