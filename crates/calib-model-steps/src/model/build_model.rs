//! The step that builds the calibration model of a study.

use std::path::{Path, PathBuf};

use calib_base::{
    StepError,
    artefact::{Below, DirectoryLock},
    bail,
    clock::Stopwatch,
    log::{
        context::RunContext,
        partition::{self, span},
        plant_of_study,
        prepared::{self, Known},
    },
    options::BuildOptions,
    outcome::{Freshness, Outcome, StepResult},
    output::Printer,
};
use calib_core::{Frames, Seed, Silent, States, Transitions};
use calib_data::Dataset;
use calib_files::{ScratchPlace, write_json};
use calib_knn::{Ends, KnnModel, ModelConfig, Parts, Recurrence, Workplace, closed_classes};
use calib_model::{JumpStatistics, ModelFamily, StartSource, rollout, start_states};
use calib_study::{Job, Study};
use rayon::prelude::*;
use serde::Serialize;

use crate::{
    model::{
        build_check::{check_against_brute_force, recall_of},
        build_cost, build_network,
        build_plan::{BuildPlan, Spilled, Training},
        built_model::BuiltModel,
        member_recurrence::MemberRecurrence,
        model_files::{self, MemberSummary, ModelFacts, ModelManifest, model_key},
    },
    represent::{self, Representation},
};

/// The subfolder of the model's directory that holds finished parts until the tables are written.
const PARTIAL: &str = "partial";
/// Steps of the rollout that measures how often each member jumps.
const PROBE_STEPS: usize = 10_000;

/// Builds the model of a study.
///
/// # Errors
/// If the study has no model or asks for something that its kind does not support, the log cannot be read, memory or
/// disk do not suffice, or the observer asks to stop.
pub fn run(
    job: &Job,
    options: &BuildOptions,
    context: &RunContext,
) -> Result<StepResult<BuiltModel, Option<BuildPlan>>, StepError> {
    let clock = Stopwatch::start();
    model_files::require_model(job)?;
    let study = job.study();
    let paths = job.layout();
    if study.model.kind.family() == ModelFamily::Network {
        return build_network::run(job, options, context);
    }
    if options.device.is_some() {
        bail!("--device is for networks, and model.kind is \"knn\"; leave it out");
    }
    let directory = paths.model();
    let data = plant_of_study::data_of(job)?;
    let is_dry = job.policy().is_dry();
    let memory = options.memory;
    let known = if is_dry {
        prepared::look(job, &data, memory, context)?
    } else {
        Known::Prepared(Box::new(prepared::open(job, &data, memory, context)?))
    };
    let training = Training::of(&known);
    let config = ModelConfig { index: options.index.unwrap_or(study.model.index), ..*study.model };
    let model_rows = partition::model_rows(study, &training.timestamps)?;
    let width = represent::width(study, paths, training.columns);
    let plan = BuildPlan::new(&training, model_rows, &config, width, options)?;
    drop(training);
    context.say(&plan.sentence());
    let Known::Prepared(prepared) = known else {
        return Ok(planned(plan, &directory, context));
    };
    if is_dry {
        build_cost::expect(job, *prepared, &config, width, &plan, context)?;
        return Ok(planned(plan, &directory, context));
    }
    let partition::Parts { dataset, pretrain, states } = partition::parts(study, *prepared)?;
    if study.model.period.is_some() && pretrain.is_none() {
        context.say(&format!("the model is built from {} alone", span(&dataset.train)?));
    }
    // `parts` is destructured here, because only states without another owner can be mapped from files.
    if let Some(part) = pretrain {
        context.say(&format!(
            "the model is built from {}; {} is for pre-training",
            span(&dataset.train)?,
            span(&part.frames)?
        ));
    }
    model_files::sensor_columns(study, &dataset.normaliser, &dataset.profile)?;
    let representation = represent::open(job, &dataset)?;
    let key = model_key(&dataset.fingerprint, &study.model, representation.as_ref())?;
    let existing = ModelManifest::of_job(job, &key, context)?;
    let (manifest, freshness) = if let Some(manifest) = existing
        && is_still_there(&directory, &key)?
    {
        let representation = representation.as_ref();
        (refresh(manifest, study, &dataset, representation, &directory)?, Freshness::Kept)
    } else {
        plan.require_room(states.as_deref(), &directory)?;
        let representation = representation.as_ref();
        let how = BuildMethod { key, config, plan, states, force: job.policy().redoes() };
        let built = build(study, dataset, representation, &how, &directory, clock, context)?;
        (built, Freshness::Made)
    };
    let verified = if options.verify > 0 {
        check_against_brute_force(job, options.verify, context)?
    } else {
        Outcome::Done
    };
    let took = clock.elapsed();
    Ok(StepResult::Made(BuiltModel { manifest, directory, freshness, took, verified }))
}

/// Reports what would be built.
fn planned(
    plan: BuildPlan,
    directory: &Path,
    printer: &Printer,
) -> StepResult<BuiltModel, Option<BuildPlan>> {
    printer.say(&format!("dry run: nothing written to {}", directory.display()));
    StepResult::Planned(Some(plan))
}

/// Removes the remaining parts of a build that was killed at its very end, and returns whether the model still exists.
/// Another calib may have begun another build, and the parts then belong to that one.
fn is_still_there(directory: &Path, key: &str) -> Result<bool, StepError> {
    let parts = directory.join(PARTIAL);
    if !parts.exists() {
        return Ok(true);
    }
    let _lock = DirectoryLock::new(directory, Below::Ours)?;
    let is_there = ModelManifest::find(directory, key).is_some();
    if is_there {
        Parts::new(parts, key).remove()?;
    }
    Ok(is_there)
}

/// How a model is built. Only the key affects its tables.
struct BuildMethod {
    /// Fingerprint of all inputs of the tables.
    key: String,
    /// The settings, with the search structure of the command line.
    config: ModelConfig,
    plan: BuildPlan,
    /// The file of the states, if they have one.
    states: Option<PathBuf>,
    force: bool,
}

impl BuildMethod {
    fn workplace(&self, directory: &Path, parts: Parts) -> Workplace {
        let mut workplace = Workplace { parts: Some(parts), ..Workplace::default() };
        if self.plan.spill == Spilled::Everything {
            workplace.scratch = ScratchPlace::Disk(directory.to_owned());
        }
        workplace
    }
}

fn build(
    study: &Study,
    mut dataset: Dataset,
    representation: Option<&Representation>,
    how: &BuildMethod,
    directory: &Path,
    clock: Stopwatch,
    printer: &Printer,
) -> Result<ModelManifest, StepError> {
    let transitions = Transitions::new(dataset.train.segments().clone());
    if let Some(representation) = representation {
        // The plan could not always know the number of coordinates of ψ. Check it before an existing model is given up.
        KnnModel::check(Some(representation.psi.columns()), &transitions, &how.config)?;
    }
    let claim = DirectoryLock::begun(directory)?;
    // It is not needed any more, and takes memory.
    dataset.held_out = None;
    let read = clock.elapsed();
    model_files::write_states(directory, &dataset.train, how.states.as_deref())?;
    if how.plan.spill != Spilled::Nothing {
        dataset.train = model_files::map_states(directory, &dataset.train)?;
    }
    let parts = Parts::new(directory.join(PARTIAL), &how.key);
    if how.force {
        parts.remove()?;
    }
    let workplace = how.workplace(directory, parts.clone());
    let kept = clock.elapsed();
    let states = metric(&dataset, representation);
    let progress = printer.progress();
    let (knn, built) = KnnModel::build_in(states, transitions, &how.config, &workplace, &progress)?;
    drop(progress);
    printer.detail(&format!("search structure: {}", built.choice));
    let searched = clock.elapsed();
    model_files::write(directory, &dataset, Some(&knn))?;
    let copied = representation.map(|own| represent::copy_to(directory, own)).transpose()?;
    let members: Vec<MemberSummary> = (0..knn.members())
        .into_par_iter()
        .map(|member: usize| {
            let (classes, ends) = (built.recurrence[member].clone(), &built.ends[member]);
            summary(study, &knn, member, &dataset.train, classes, ends)
        })
        .collect::<Result<_, _>>()?;
    let recall = recall_of(study, &knn, &printer.progress())?;
    let transitions = knn.transitions().len();
    let facts = ModelFacts {
        search: Some(built.choice.without_share()),
        recall,
        ..ModelFacts::of(how.key.clone(), study, &dataset, transitions, members)
    };
    write_json(
        &directory.join("timings.json"),
        &Timings {
            reading_secs: read.as_secs_f64(),
            searching_secs: searched.saturating_sub(kept).as_secs_f64(),
            writing_secs: (clock.elapsed().saturating_sub(searched) + kept.saturating_sub(read))
                .as_secs_f64(),
        },
    )?;
    let files = model_files::file_names(knn.members(), &copied.unwrap_or_default());
    let manifest = claim.finish(facts, files.iter().map(String::as_str))?;
    // Until now a killed build could resume from the parts. The directory is still claimed.
    parts.remove()?;
    Ok(manifest)
}

/// Returns a model that is up to date, for a study that may differ in keys that do not change its tables.
fn refresh(
    mut manifest: ModelManifest,
    study: &Study,
    dataset: &Dataset,
    representation: Option<&Representation>,
    directory: &Path,
) -> Result<ModelManifest, StepError> {
    if manifest.study == *study && model_files::has_profile(&manifest, directory) {
        return Ok(manifest);
    }
    let knn = KnnModel::open(
        directory,
        metric(dataset, representation),
        Transitions::new(dataset.train.segments().clone()),
        study.model.members,
        study.model.exclusion(),
    )?;
    let weights = study.model.weights()?;
    manifest.members = manifest
        .members
        .par_iter()
        .enumerate()
        .map(|(member, old)| {
            let mut classes =
                old.recurrence.as_ref().map(|known| known.classes.clone()).unwrap_or_default();
            let (now, ends) = closed_classes(&knn, member, weights, classes.candidates, &Silent)?;
            if !study.model.remove_traps {
                classes.before = now.clone();
            }
            classes.after = now;
            summary(study, &knn, member, &dataset.train, classes, &ends)
        })
        .collect::<Result<Vec<MemberSummary>, StepError>>()?;
    model_files::rewrite(manifest, study, dataset, directory)
}

/// Returns the states in which distances are measured: the states themselves, or their representation.
fn metric(dataset: &Dataset, representation: Option<&Representation>) -> States {
    representation
        .map_or_else(|| dataset.train.states().clone(), |representation| representation.psi.clone())
}

/// Wall times: the only file of a model that differs between builds.
#[derive(Serialize)]
#[expect(clippy::struct_field_names, reason = "every number carries its unit")]
struct Timings {
    reading_secs: f64,
    searching_secs: f64,
    writing_secs: f64,
}

fn summary(
    study: &Study,
    knn: &KnnModel,
    member: usize,
    frames: &Frames,
    classes: Recurrence,
    ends: &Ends,
) -> Result<MemberSummary, StepError> {
    let weights = study.model.weights()?;
    let recurrence = MemberRecurrence::new(knn, member, classes, ends, frames, weights, study.seed);
    let tables = knn.member(member);
    let seed = Seed::new(study.seed).child("jump probe").number(member as u64);
    let starts = start_states(&tables, StartSource::Random, 1, seed)?;
    let probe = rollout(&tables, &starts[0], PROBE_STEPS, weights, seed);
    let jumps = Some(JumpStatistics::of([probe.rows()]));
    Ok(MemberSummary { transitions: tables.len(), jumps, recurrence: Some(recurrence) })
}
