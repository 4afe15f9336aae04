//! Representations of the states: trained or imported, scored, chosen.

mod candidate;
mod cost;
pub mod decisions;
mod grid;
mod import;
mod manifest;
mod material;
mod table;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    time::Duration,
};

use calib_base::{
    Context as _, StepError,
    artefact::{self, Below, DirectoryLock, Facts as _, Files},
    bail,
    clock::Stopwatch,
    ensure, frames,
    log::{context::RunContext, partition},
    memory,
    options::Device,
    outcome::{Freshness, NoPlan, Outcome, StepResult},
    output::{Printer, bytes, count, counted},
    stale::StoredArtefact,
    torch,
};
use calib_core::States;
use calib_data::Dataset;
use calib_files::{fingerprint_file, map_npy, write_npy};
use calib_nn::Mlp;
use calib_represent::{
    RepresentationKind, Scores, Split, encode, read_encoder, score, select, write_encoder,
};
use calib_study::{Job, Layout, Share, StepKind, Study};

use candidate::{Candidate, ENCODER};
pub use cost::{RepresentationCost, disk_left, takes_disk};
use cost::{needed_bytes, require_room};
pub use manifest::{RepresentationFacts, RepresentationManifest};
pub use material::Material;
use material::seed;
pub use table::report_table;
pub(crate) use table::show;

/// The file of ψ of the chosen candidate.
const PSI: &str = "representation.npy";

/// The representations of a study.
#[derive(Debug)]
pub struct Representations {
    pub(crate) manifest: RepresentationManifest,
    pub(crate) directory: PathBuf,
    pub(crate) freshness: Freshness,
    pub(crate) took: Duration,
}

impl Representations {
    /// Returns the position of the chosen representation among the candidates, or `None` if none qualifies.
    pub fn chosen(&self) -> Option<usize> {
        self.manifest.chosen
    }

    /// Returns their directory.
    pub fn directory(&self) -> &Path {
        &self.directory
    }
}

/// Trains or imports the representations of a study, and chooses one.
///
/// # Errors
/// If the study has no representation, the log or the imported file cannot be read, or the observer asks to stop.
pub fn run(
    job: &Job,
    device: Option<Device>,
    context: &RunContext,
) -> Result<StepResult<Representations>, StepError> {
    let clock = Stopwatch::start();
    let study = job.study();
    ensure!(
        study.has_model(),
        "the study has no model (model.kind = \"none\"), so nothing is searched in a representation; go on with `{}`, or set model.kind = \"knn\"",
        job.command(StepKind::Sweep)
    );
    if device.is_some() {
        torch::require("--device")?;
    }
    if study.representation.kind == RepresentationKind::None {
        bail!(
            "representation.kind is \"none\": there is nothing to train; \
             set it to \"laplacian\" or \"import\""
        );
    }
    let dataset = partition::load(job, context)?.dataset;
    let key = key(job, &dataset)?;
    let directory = job.layout().representation();
    announce(study, &dataset, context);
    if job.policy().is_dry() {
        cost::expect(job, device, &dataset, &key, context)?;
        context.say(&format!("dry run: nothing written to {}", directory.display()));
        return Ok(StepResult::Planned(NoPlan));
    }
    if let Some(share) = job.policy().share {
        train_share(job, device, &dataset, share, context)?;
        return Ok(StepResult::Nothing(Outcome::Done));
    }
    let (manifest, freshness) = match RepresentationManifest::of_job(job, &key, context)? {
        Some(manifest) => (manifest, Freshness::Kept),
        None => (make(job, device, &dataset, key, context)?, Freshness::Made),
    };
    let took = clock.elapsed();
    Ok(StepResult::Made(Representations { manifest, directory, freshness, took }))
}

/// Trains this process's share of the grid. Every candidate has its own directory, so shares need no common claim.
fn train_share(
    job: &Job,
    device: Option<Device>,
    dataset: &Dataset,
    share: Share,
    printer: &Printer,
) -> Result<(), StepError> {
    let study = job.study();
    let directory = job.layout().representation();
    if study.representation.kind == RepresentationKind::Import {
        printer.say("an imported representation is not trained: there is nothing to share");
        return Ok(());
    }
    let material = Material::of(dataset);
    if device.is_none() {
        memory::require(needed_bytes(study, material), "training the representations", LESS)?;
    }
    let split = Split::in_time(material.segments)?;
    let trained = grid::train_share(study, material, &split, device, &directory, share, printer)?;
    printer.result(&format!(
        "share {share}: {} trained, of {} in all",
        counted(trained, "representation"),
        study.representation.candidates().len()
    ))?;
    printer.next(&[job.command(StepKind::Represent)]);
    Ok(())
}

/// The remedy if memory does not suffice.
const LESS: &str =
    "lower representation.hidden_units or representation.batch_size, or use fewer --threads";

/// The error if no candidate qualifies.
pub(crate) const NONE_QUALIFIES: &str = "no representation tells more than 95 % of the distinct states apart; \
    try a greater `zeta` or `dimension`, more `steps`, or a smaller `learning_rate` in [representation]";

/// Returns the fingerprint of all inputs of the representations.
fn key(job: &Job, dataset: &Dataset) -> Result<String, StepError> {
    let study = job.study();
    let imported = match study.representation.kind {
        RepresentationKind::Import => Some(fingerprint_file(&import::file(job)?)?),
        _ => None,
    };
    artefact::key(&(
        RepresentationFacts::FORMAT,
        &dataset.fingerprint,
        &study.representation,
        study.seed,
        imported,
    ))
}

fn announce(study: &Study, dataset: &Dataset, printer: &Printer) {
    let rows = dataset.train.rows();
    let columns = dataset.train.states().columns();
    if study.representation.kind == RepresentationKind::Import {
        let path = study.representation.path.as_deref().unwrap_or_default();
        printer.say(&format!("{} rows x {columns} columns; importing {path}", count(rows)));
        return;
    }
    let candidates = study.representation.candidates();
    let steps: usize = candidates.iter().map(|candidate| candidate.steps).sum();
    let widest = candidates.iter().map(|candidate| candidate.dimension).max().unwrap_or(0);
    let at_once = rayon::current_num_threads().min(candidates.len());
    printer.say(&format!(
        "{} rows x {columns} columns; {} of up to {widest} dimensions, {} steps in all, \
         {at_once} at a time; expecting {} of memory",
        count(rows),
        counted(candidates.len(), "representation"),
        count(steps),
        bytes(needed_bytes(study, Material::of(dataset))),
    ));
}

/// Representations, and the chosen one.
struct TriedCandidates {
    candidates: Vec<Candidate>,
    chosen: Option<usize>,
    /// ψ of the chosen candidate.
    psi: Option<States>,
    encoder: Option<Mlp>,
}

fn make(
    job: &Job,
    device: Option<Device>,
    dataset: &Dataset,
    key: String,
    printer: &Printer,
) -> Result<RepresentationManifest, StepError> {
    require_room(job, dataset)?;
    let directory = &job.layout().representation();
    let material = Material::of(dataset);
    let claim = DirectoryLock::new(directory, Below::Ours)?;
    made(job, directory, &claim, material, key, |split| {
        if job.study().representation.kind == RepresentationKind::Import {
            return imported(job, dataset, split);
        }
        trained(job, device, material, split, directory, printer)
    })
}

/// Makes the content of a directory that this process has claimed. `try_all` tries the candidates on the given split.
fn made(
    job: &Job,
    directory: &Path,
    claim: &DirectoryLock,
    material: Material<'_>,
    key: String,
    try_all: impl FnOnce(&Split) -> Result<TriedCandidates, StepError>,
) -> Result<RepresentationManifest, StepError> {
    let split = Split::in_time(material.segments)?;
    claim.begin()?;
    if job.policy().redoes() {
        // From here on everything is made again, so that an interrupted run resumes without `--force`.
        grid::remove(directory)?;
    }
    let TriedCandidates { candidates, chosen, psi, encoder } = try_all(&split)?;
    let mut files = vec!["candidates.parquet", "curves.parquet"];
    if let Some(encoder) = encoder {
        write_encoder(&directory.join(ENCODER), &encoder, BTreeMap::new())?;
        files.push(ENCODER);
    }
    if let Some(psi) = psi {
        write_npy(&directory.join(PSI), psi.as_slice(), psi.rows(), psi.columns())?;
        files.push(PSI);
    }
    table::write(directory, &candidates, chosen)?;
    let facts = RepresentationFacts {
        key,
        study: job.study().clone(),
        data: material.fingerprint.clone(),
        validation_rows: split.validation.len(),
        candidates,
        chosen,
    };
    claim.finish(facts, files)
}

fn score_of(study: &Study, material: Material<'_>, split: &Split, psi: &States) -> Scores {
    score(material.states, psi, material.segments, &split.validation, seed(study))
}

fn imported(job: &Job, dataset: &Dataset, split: &Split) -> Result<TriedCandidates, StepError> {
    let psi = import::read(job, dataset)?;
    let scores = Some(score_of(job.study(), Material::of(dataset), split, &psi));
    let candidate =
        Candidate { config: None, directory: None, scores, divergence: None, points: vec![] };
    let chosen = select(&[scores]);
    Ok(TriedCandidates {
        candidates: vec![candidate],
        chosen,
        psi: chosen.map(|_| psi),
        encoder: None,
    })
}

fn trained(
    job: &Job,
    device: Option<Device>,
    material: Material<'_>,
    split: &Split,
    directory: &Path,
    printer: &Printer,
) -> Result<TriedCandidates, StepError> {
    let study = job.study();
    if device.is_none() {
        memory::require(needed_bytes(study, material), "training the representations", LESS)?;
    }
    let trained = grid::train(study, material, split, device, directory, printer)?;
    scored(study, material, split, &trained)
}

/// Scores every candidate by its encoder, which is missing if its training diverged, and chooses one.
fn scored(
    study: &Study,
    material: Material<'_>,
    split: &Split,
    trained: &[(Candidate, Option<Mlp>)],
) -> Result<TriedCandidates, StepError> {
    let candidates: Vec<Candidate> = trained
        .iter()
        .map(|(candidate, encoder)| {
            // ψ of a state outside the training data may overflow.
            let psi = encoder.as_ref().and_then(|encoder| encode(encoder, material.states).ok());
            let scores = psi.as_ref().map(|psi| score_of(study, material, split, psi));
            Candidate { scores, ..candidate.clone() }
        })
        .collect();
    let scores: Vec<Option<Scores>> = candidates.iter().map(|candidate| candidate.scores).collect();
    let chosen = select(&scores);
    let encoder = chosen.and_then(|chosen| trained[chosen].1.clone());
    let psi = encoder.as_ref().map(|encoder| encode(encoder, material.states)).transpose()?;
    Ok(TriedCandidates { candidates, chosen, psi, encoder })
}

/// The chosen representation of the training states.
pub(crate) struct Representation {
    /// Fingerprint of its inputs and content.
    pub(crate) key: String,
    /// ψ of every state.
    pub(crate) psi: States,
    /// The encoder for other states; `None` for an imported representation.
    pub(crate) encoder: Option<Mlp>,
}

/// Opens the output of `calib represent` for the study, or returns `None` if neighbours are searched among the states
/// themselves.
pub(crate) fn open(job: &Job, dataset: &Dataset) -> Result<Option<Representation>, StepError> {
    let study = job.study();
    let paths = job.layout();
    if study.representation.kind == RepresentationKind::None {
        return Ok(None);
    }
    let directory = paths.representation();
    let command = job.command(StepKind::Represent);
    let manifest: RepresentationManifest = artefact::require(&directory, &command)?;
    StoredArtefact { step: StepKind::Represent, study: &manifest.study, directory: &directory }
        .check(job)?;
    if manifest.key != key(job, dataset)? {
        return Err(StepError::Stale(format!(
            "the representation in {} was made from other data; run `{command}` again",
            directory.display()
        )));
    }
    read(&directory, &manifest, &command).map(Some)
}

/// Returns the error that no candidate qualifies, so that `directory` has no representation.
fn none_qualifies(directory: &Path, command: &str) -> StepError {
    StepError::message(format!("{}: {NONE_QUALIFIES}; then run `{command}`", directory.display()))
}

/// Reads the output of `command` in `directory`.
fn read(
    directory: &Path,
    manifest: &RepresentationManifest,
    command: &str,
) -> Result<Representation, StepError> {
    if manifest.chosen.is_none() {
        return Err(none_qualifies(directory, command));
    }
    let again = format!("{} is damaged; run `{command} --force`", directory.display());
    let used = [PSI, ENCODER].into_iter();
    let used = used.filter_map(|name| Some((name.to_owned(), manifest.files.get(name)?.clone())));
    let used: Files = used.collect();
    artefact::check_files(directory, &used, command)?;
    let psi = frames::map_states(&directory.join(PSI)).context(&again)?;
    let encoder = manifest
        .files
        .contains_key(ENCODER)
        .then(|| read_encoder(&directory.join(ENCODER)))
        .transpose()
        .context(&again)?;
    Ok(Representation { key: artefact::key(&(&manifest.key, used))?, psi, encoder })
}

/// The number of coordinates in which neighbours are searched, as far as it is known before the representation is
/// opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Width {
    /// The columns of the states.
    OfStates,
    /// The dimension of ψ, the same for all candidates.
    Exactly(usize),
    /// The probable dimension of ψ. It is exact if ψ exists and is not made again.
    Perhaps(usize),
}

impl Width {
    /// Returns the number of coordinates, given the number of columns of the states.
    pub(crate) fn coordinates(self, columns: usize) -> usize {
        match self {
            Self::OfStates => columns,
            Self::Exactly(coordinates) | Self::Perhaps(coordinates) => coordinates,
        }
    }
}

/// Returns the width of the states that the study searches, given the number of columns of the states.
pub(crate) fn width(study: &Study, paths: &Layout, columns: usize) -> Width {
    let config = &study.representation;
    let candidates = match config.kind {
        RepresentationKind::None => return Width::OfStates,
        RepresentationKind::Laplacian => config.candidates(),
        RepresentationKind::Import => Vec::new(),
    };
    let dimensions = candidates.iter().map(|candidate| candidate.dimension);
    let widest = dimensions.clone().max();
    if let Some(only) = widest.filter(|_| dimensions.min() == widest) {
        return Width::Exactly(only);
    }
    let directory = paths.representation();
    let made = artefact::read::<RepresentationManifest>(&directory)
        .filter(|found| found.study.representation == *config)
        .and_then(|_| map_npy::<f32>(&directory.join(PSI)).ok());
    Width::Perhaps(made.map(|psi| psi.columns()).or(widest).unwrap_or(columns))
}

/// Copies the representation into a model's directory, which then needs no other files. Returns the names of the files.
pub(crate) fn copy_to(
    directory: &Path,
    representation: &Representation,
) -> Result<Vec<&'static str>, StepError> {
    let Representation { psi, encoder, .. } = representation;
    write_npy(&directory.join(PSI), psi.as_slice(), psi.rows(), psi.columns())?;
    let Some(encoder) = encoder else { return Ok(vec![PSI]) };
    write_encoder(&directory.join(ENCODER), encoder, BTreeMap::new())?;
    Ok(vec![PSI, ENCODER])
}

/// Reads the representation in a model's directory, in which its neighbours were searched.
pub(crate) fn of_model(
    directory: &Path,
    files: &Files,
) -> Result<(Option<States>, Option<Mlp>), StepError> {
    let psi =
        files.contains_key(PSI).then(|| frames::map_states(&directory.join(PSI))).transpose()?;
    let encoder =
        files.contains_key(ENCODER).then(|| read_encoder(&directory.join(ENCODER))).transpose()?;
    Ok((psi, encoder))
}
