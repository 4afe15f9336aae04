//! Checks that the disk has room for all files of a run before it writes any.

use calib_base::{
    StepError, disk_room,
    log::{context::RunContext, partition},
    torch,
};
use calib_model_steps::{model::build_plan, represent};
use calib_study::{Job, Scope, StepKind};
use calib_sweep_steps::sweep::{candidates::candidates_of, expected};

use crate::{plan::Plan, run_progress::passes};

/// Refuses a run if the disk has no room for its models and sweeps together. Each step checks again before it writes,
/// when more is known.
///
/// # Errors
/// Returns an error if there is clearly less room, or the log cannot be read.
pub(crate) fn require_room<'a>(
    job: &Job,
    models: impl Iterator<Item = &'a Job>,
    plan: &Plan,
    context: &RunContext,
) -> Result<(), StepError> {
    if job.policy().is_dry() || job.policy().share.is_some() {
        return Ok(());
    }
    let mut needed = 0_u64;
    for model in models.filter(|model| !is_left_out(model, plan)) {
        let own = model_bytes(model, plan, context)?.saturating_add(sweep_bytes(model, plan)?);
        needed = needed.saturating_add(own);
    }
    disk_room::require(
        needed,
        "what is left of the study",
        job.layout().root(),
        "choose a folder on another disk with --output, lower model.neighbors, model.members or sweep.curve_points, or sweep fewer settings",
    )
}

/// Whether a model is going to be left out, because this calib cannot train it. It takes nothing.
fn is_left_out(model: &Job, plan: &Plan) -> bool {
    torch::lacks(model.study().model.kind) && plan.has_to_do(StepKind::BuildModel, model)
}

/// Bytes that a model and its representation still take; nothing where both are up to date or take hardly any disk. Then the log is not read.
fn model_bytes(model: &Job, plan: &Plan, context: &RunContext) -> Result<u64, StepError> {
    let represents = represent::takes_disk(model) && plan.has_to_do(StepKind::Represent, model);
    let builds = build_plan::takes_disk(model) && plan.has_to_do(StepKind::BuildModel, model);
    if !represents && !builds {
        return Ok(0);
    }
    let job = model.before_deployment()?;
    let dataset = partition::load(&job, context)?.dataset;
    let representation = if represents { represent::disk_left(&job, &dataset) } else { 0 };
    let tables = if builds { build_plan::disk_left(&job, &dataset) } else { 0 };
    Ok(representation.saturating_add(tables))
}

/// Returns the bytes of the sweeps that have not begun. Those of the others are only known after their runs are
/// counted.
fn sweep_bytes(model: &Job, plan: &Plan) -> Result<u64, StepError> {
    let mut needed = 0_u64;
    for part in model.parts(Scope::Deployment)? {
        if !plan.is_to_do(StepKind::Sweep, &part) || part.layout().sweep().exists() {
            continue;
        }
        let study = part.study();
        let settings = candidates_of(study)?.len();
        let units = passes(study).saturating_mul(study.sweep.sensors.len());
        let runs = units.saturating_mul(settings);
        needed = needed.saturating_add(expected::certain_bytes(study, runs));
    }
    Ok(needed)
}
