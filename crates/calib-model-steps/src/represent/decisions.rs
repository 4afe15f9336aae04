//! The representation of a log of decisions, which `calib control` trains itself.

use calib_base::{
    Context as _, StepError,
    artefact::{self, Below, DirectoryLock, Facts as _},
    memory,
    output::Printer,
};
use calib_core::{Monitor, States};
use calib_represent::{Split, encode};
use calib_study::{Job, StepKind, Study};

use super::{
    LESS, Material, RepresentationCost, RepresentationFacts, RepresentationManifest,
    TriedCandidates, grid, made, needed_bytes, none_qualifies, read, scored, trained,
};

/// Returns the fingerprint of all inputs of the representation of the states of `material`. The kind of representation
/// of a model without actions does not matter.
fn key(job: &Job, material: Material<'_>) -> Result<String, StepError> {
    let study = job.study();
    let candidates = study.representation.candidates();
    let format = RepresentationFacts::FORMAT;
    artefact::key(&("decisions", format, material.fingerprint, candidates, study.seed))
}

/// Returns ψ of every state. It is read, or trained by `[representation]` on pairs along the episodes, and chosen as
/// for prediction.
///
/// One share of a sweep writes it. Other shares that begin meanwhile train the same in memory.
///
/// # Errors
/// If none qualifies, it cannot be trained or written, or the observer asks to stop.
pub fn open_or_train(
    job: &Job,
    material: Material<'_>,
    printer: &Printer,
) -> Result<States, StepError> {
    let directory = &job.layout().control_representation();
    let command = job.command(StepKind::Control);
    let key = key(job, material)?;
    let kept =
        if job.policy().redoes() { None } else { RepresentationManifest::find(directory, &key) };
    if let Some(manifest) = kept {
        return Ok(read(directory, &manifest, &command)?.psi);
    }
    let claim = if job.policy().share.is_some() {
        DirectoryLock::try_new(directory, Below::Ours)?
    } else {
        Some(DirectoryLock::new(directory, Below::Ours)?)
    };
    let Some(claim) = claim else {
        let tried = trained_in_memory(job.study(), material, printer)?;
        return tried.psi.ok_or_else(|| none_qualifies(directory, &command));
    };
    let manifest = made(job, directory, &claim, material, key, |split| {
        trained(job, None, material, split, directory, printer)
    })?;
    Ok(read(directory, &manifest, &command)?.psi)
}

/// Returns ψ of other `states` with the same columns, by the representation of `material`. It is read, or trained.
///
/// # Errors
/// As [`open_or_train`], or if ψ of a state is not finite.
pub fn encode_others(
    job: &Job,
    material: Material<'_>,
    states: &States,
    printer: &Printer,
) -> Result<States, StepError> {
    let directory = &job.layout().control_representation();
    let command = job.command(StepKind::Control);
    if RepresentationManifest::find(directory, &key(job, material)?).is_none() {
        open_or_train(job, material, printer)?;
    }
    let manifest: RepresentationManifest = artefact::require(directory, &command)?;
    let encoder = read(directory, &manifest, &command)?.encoder;
    let encoder = encoder.with_context(|| format!("{} has no encoder", directory.display()))?;
    encode(&encoder, states).context("states of a held-out period")
}

/// Trains the whole grid without writing anything, and chooses one candidate.
fn trained_in_memory(
    study: &Study,
    material: Material<'_>,
    printer: &Printer,
) -> Result<TriedCandidates, StepError> {
    memory::require(needed_bytes(study, material), "training the representations", LESS)?;
    let split = Split::in_time(material.segments)?;
    let trained = grid::train_in_memory(study, material, &split, printer)?;
    scored(study, material, &split, &trained)
}

/// Repeats the training if its files exist and are damaged. The new result is the same to the byte.
///
/// # Errors
/// If it cannot be trained, or written.
pub fn mend(job: &Job, material: Material<'_>, printer: &Printer) -> Result<(), StepError> {
    let directory = &job.layout().control_representation();
    if directory.exists() && RepresentationManifest::find(directory, &key(job, material)?).is_none()
    {
        open_or_train(job, material, printer)?;
    }
    Ok(())
}

/// Reads ψ of every state, if it was trained and a candidate qualified.
///
/// # Errors
/// If its files have changed since they were written.
pub fn kept(job: &Job, material: Material<'_>) -> Result<Option<States>, StepError> {
    let directory = &job.layout().control_representation();
    let Some(manifest) = RepresentationManifest::find(directory, &key(job, material)?) else {
        return Ok(None);
    };
    if manifest.chosen.is_none() {
        return Ok(None);
    }
    Ok(Some(read(directory, &manifest, &job.command(StepKind::Control))?.psi))
}

/// Returns the cost of making the representation if it does not exist. Some updates are made and timed, and nothing is
/// written.
///
/// # Errors
/// If all candidates exist and none qualifies, training does not fit into memory or is impossible, or the monitor
/// interrupts.
pub fn cost(
    job: &Job,
    material: Material<'_>,
    monitor: &dyn Monitor,
) -> Result<Option<RepresentationCost>, StepError> {
    let study = job.study();
    let directory = job.layout().control_representation();
    let left = if job.policy().redoes() {
        study.representation.candidates()
    } else {
        let key = key(job, material)?;
        if let Some(manifest) = RepresentationManifest::find(&directory, &key) {
            read(&directory, &manifest, &job.command(StepKind::Control))?;
            return Ok(None);
        }
        grid::left(study, material, &directory)?
    };
    memory::require(needed_bytes(study, material), "training the representations", LESS)?;
    RepresentationCost::measure(study, material, &left, monitor).map(Some)
}

/// Returns the manifest of the representation that `calib control` trained, for the report.
pub fn manifest(job: &Job) -> Option<RepresentationManifest> {
    artefact::read(&job.layout().control_representation())
}
