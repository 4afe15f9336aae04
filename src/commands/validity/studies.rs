//! Which studies there are, and running what is missing of them.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use calib_core::Seed;
use calib_knn::ModelKind;
use calib_sweep::{Candidate, candidates};

use super::super::{artefact::MANIFEST, chain, evaluate, load_study};
use crate::{
    cli::{StudyArgs, ValidityArgs},
    output::Printer,
    study::{Chosen, Study},
};

/// A study on the command line.
pub(super) struct Listed {
    /// What the plant is called: the name of the file without `.toml`.
    pub(super) plant: String,
    pub(super) path: PathBuf,
    /// Its models; `None` for a study with one model that has no name.
    pub(super) models: Vec<Option<String>>,
    /// Its deployments; `None` for a study with one held-out range that has no name.
    pub(super) deployments: Vec<Option<String>>,
}

/// The studies that `args` name; a folder stands for all `*.toml` in it, in alphabetical order.
pub(super) fn list(args: &ValidityArgs) -> anyhow::Result<Vec<Listed>> {
    let mut studies: Vec<Listed> = Vec::new();
    for path in &args.studies {
        for path in files(path)? {
            let plant = path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
            let plant = plant.with_context(|| format!("{} has no name", path.display()))?;
            if let Some(other) = studies.iter().find(|other| other.plant == plant) {
                bail!(
                    "{} and {} are both called {plant}, and a study stands for a plant: intervals are over plants; \
                     rename one, or leave it out",
                    other.path.display(),
                    path.display()
                );
            }
            let models = or_the_only(Study::model_names(&path, &args.set, None)?);
            let (study, _) = Study::load(&path, &args.set, Chosen::default())?;
            let deployments = or_the_only(study.deployment_names());
            studies.push(Listed { plant, path, models, deployments });
        }
    }
    Ok(studies)
}

/// What is known before anything is run: whether there is held-out data to judge by, and whether all sweep the same.
pub(super) fn check(studies: &[Listed], args: &ValidityArgs) -> anyhow::Result<()> {
    let mut first: Option<(&Listed, Vec<String>)> = None;
    for study in studies {
        let (settings, _) = Study::load(&study.path, &args.set, Chosen::default())?;
        let data = &settings.data;
        let holds_nothing_out =
            data.held_out.is_none() && (data.train.is_some() || data.train_fraction >= 1.0);
        ensure!(
            !holds_nothing_out || study.deployments.iter().any(Option::is_some),
            "{} holds no data out, so nobody can say how well calib chooses there; set data.held_out, or leave it out",
            study.path.display()
        );
        let seed = Seed::new(settings.seed).child("sweep");
        let candidates = candidates(&settings.sweep, &settings.agent, seed)
            .with_context(|| study.path.display().to_string())?;
        let values: Vec<String> = candidates.iter().map(Candidate::label).collect();
        match &first {
            None => first = Some((study, values)),
            Some((other, theirs)) if *theirs != values => bail!(
                "the studies sweep different values: {} has {}, {} has {}; give all the same [sweep.grid], or judge them apart",
                other.plant,
                theirs.join(", "),
                study.plant,
                values.join(", ")
            ),
            Some(_) => {}
        }
    }
    Ok(())
}

fn or_the_only(names: Vec<String>) -> Vec<Option<String>> {
    if names.is_empty() { vec![None] } else { names.into_iter().map(Some).collect() }
}

fn files(path: &Path) -> anyhow::Result<Vec<PathBuf>> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let entries =
        std::fs::read_dir(path).with_context(|| format!("cannot read {}", path.display()))?;
    let mut files: Vec<PathBuf> = entries
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.is_file() && path.extension().is_some_and(|of| of == "toml"))
        .collect();
    ensure!(!files.is_empty(), "{} has no study (*.toml)", path.display());
    files.sort();
    Ok(files)
}

/// The arguments of the other commands for a model of a study in a deployment.
pub(super) fn args_of(
    study: &Listed,
    (model, deployment): (Option<&str>, Option<&str>),
    args: &ValidityArgs,
) -> StudyArgs {
    StudyArgs {
        study: study.path.clone(),
        set: args.set.clone(),
        model: model.map(str::to_owned),
        deployment: deployment.map(str::to_owned),
        profile: None,
        output: None,
        force: false,
        dry_run: false,
        json: false,
    }
}

/// Say what there is and what would be run.
pub(super) fn announce(
    studies: &[Listed],
    args: &ValidityArgs,
    printer: &Printer,
) -> anyhow::Result<()> {
    for study in studies {
        for model in &study.models {
            let first = study.deployments.first().and_then(Option::as_deref);
            let args = args_of(study, (model.as_deref(), first), args);
            load_study(&args)?;
            let state = if evaluate::judge(&args).is_ok() { "is swept" } else { "is to be run" };
            let model = model.as_deref().map_or_else(String::new, |name| format!(", {name}"));
            printer.result(&format!("{}{model} {state}", study.plant))?;
        }
    }
    Ok(())
}

/// Run what is missing of a study: `calib run`, whose results are only steps here.
pub(super) fn complete(
    study: &Listed,
    args: &ValidityArgs,
    printer: &Printer,
) -> anyhow::Result<()> {
    chain::run(&args_of(study, (None, None), args), &printer.talking()).map(|_| ())
}

/// Why a model is not there, if it is one that this calib cannot train.
pub(super) fn missing(
    study: &Listed,
    model: Option<&str>,
    args: &ValidityArgs,
) -> anyhow::Result<Option<String>> {
    let (settings, paths) = load_study(&args_of(study, (model, None), args))?;
    let wants_libtorch = matches!(settings.model.kind, ModelKind::Gru | ModelKind::Torchscript);
    let is_missing =
        wants_libtorch && !cfg!(feature = "torch") && !paths.model().join(MANIFEST).exists();
    Ok(is_missing.then(|| {
        format!(
            "{} of {} is left out: it wants libtorch, which this calib was built without, and no other one has built it",
            model.unwrap_or("the model"),
            study.plant
        )
    }))
}
