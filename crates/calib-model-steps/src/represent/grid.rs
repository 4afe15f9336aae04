//! Training of a grid of representations, several side by side, each on one core.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use calib_base::{StepError, artefact, options::Device, output::Printer, torch};
use calib_core::Monitor as _;
use calib_files::{
    CheckpointFile, FileError, Fingerprint, fingerprint_file, is_temporary, read_sealed_json,
    remove_known, write_sealed_json,
};
use calib_nn::Mlp;
use calib_represent::{
    Divergence, LaplacianConfig, Point, Split, Task, read_encoder, train as train_one,
    write_encoder,
};
use calib_study::{Share, Study};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{
    candidate::{Candidate, ENCODER},
    material::{Material, seed},
};

/// Version of the training: increased when the same configuration and seed lead to other weights.
const TRAINING: u32 = 1;

/// The subfolder of the candidates, in the directory of the representation.
const CANDIDATES: &str = "candidates";

/// `training.json` of a candidate, which is written last.
#[derive(Debug, Serialize, Deserialize)]
struct TrainingRecord {
    key: String,
    config: LaplacianConfig,
    divergence: Option<Divergence>,
    points: Vec<Point>,
    /// Fingerprint of the encoder's file.
    encoder: Fingerprint,
}

const RECORD: &str = "training.json";
/// The file of an interrupted training.
const CHECKPOINT: &str = "checkpoint.safetensors";
/// Number of digits in the name of a candidate's directory.
const KEY_DIGITS: usize = 16;

/// Trains the missing part of the grid. Returns every candidate, still without scores, and its encoder unless it
/// diverged.
pub(super) fn train(
    study: &Study,
    material: Material<'_>,
    split: &Split,
    device: Option<Device>,
    directory: &Path,
    printer: &Printer,
) -> Result<Vec<(Candidate, Option<Mlp>)>, StepError> {
    let grid = keyed(study, material)?;
    train_missing(&grid, task(study, material, split), device, directory, printer)?;
    grid.iter().map(|(key, _)| finished(&place(directory, key), key)).collect()
}

/// Trains the missing part of a share of the grid. Returns the number of candidates of the share.
pub(super) fn train_share(
    study: &Study,
    material: Material<'_>,
    split: &Split,
    device: Option<Device>,
    directory: &Path,
    share: Share,
    printer: &Printer,
) -> Result<usize, StepError> {
    artefact::own(directory)?;
    let grid = keyed(study, material)?.into_iter().enumerate();
    let own: Vec<KeyedCandidate> =
        grid.filter(|(place, _)| share.has(*place)).map(|(_, keyed)| keyed).collect();
    train_missing(&own, task(study, material, split), device, directory, printer)?;
    Ok(own.len())
}

/// Trains the whole grid without writing anything. Returns every candidate, still without scores, and its encoder
/// unless it diverged.
pub(super) fn train_in_memory(
    study: &Study,
    material: Material<'_>,
    split: &Split,
    printer: &Printer,
) -> Result<Vec<(Candidate, Option<Mlp>)>, StepError> {
    let task = task(study, material, split);
    let grid = study.representation.candidates();
    let progress = printer.progress();
    progress.begin("training", grid.iter().map(|config| config.steps as u64).sum());
    grid.into_par_iter()
        .map(|config| -> Result<(Candidate, Option<Mlp>), StepError> {
            let trained = train_one(&config, task, None, &progress)?;
            let encoder = trained.divergence.is_none().then_some(trained.encoder);
            let candidate = Candidate {
                config: Some(config),
                directory: None,
                scores: None,
                divergence: trained.divergence,
                points: trained.points,
            };
            Ok((candidate, encoder))
        })
        .collect()
}

/// Returns the data that every candidate is trained on.
fn task<'a>(study: &Study, material: Material<'a>, split: &'a Split) -> Task<'a> {
    Task { states: material.states, segments: material.segments, split, seed: seed(study) }
}

/// A candidate, and the fingerprint of its inputs.
type KeyedCandidate = (String, LaplacianConfig);

fn keyed(study: &Study, material: Material<'_>) -> Result<Vec<KeyedCandidate>, StepError> {
    study
        .representation
        .candidates()
        .into_iter()
        .map(|config| {
            Ok((artefact::key(&(TRAINING, material.fingerprint, &config, study.seed))?, config))
        })
        .collect()
}

/// Returns the candidates of the grid whose training is not finished in `directory`.
pub(super) fn left(
    study: &Study,
    material: Material<'_>,
    directory: &Path,
) -> Result<Vec<LaplacianConfig>, StepError> {
    let grid = keyed(study, material)?.into_iter();
    let left = grid.filter(|(key, _)| read(&place(directory, key), key).is_none());
    Ok(left.map(|(_, config)| config).collect())
}

/// Returns the directory of a candidate.
fn place(directory: &Path, key: &str) -> PathBuf {
    directory.join(CANDIDATES).join(short(key))
}

fn train_missing(
    grid: &[KeyedCandidate],
    task: Task<'_>,
    device: Option<Device>,
    directory: &Path,
    printer: &Printer,
) -> Result<(), StepError> {
    let (there, missing): (Vec<_>, Vec<_>) =
        grid.iter().partition(|(key, _)| read(&place(directory, key), key).is_some());
    // A process that was killed between the record and the end of a training has left its checkpoint.
    there.iter().try_for_each(|(key, _)| checkpoint(&place(directory, key), key).remove())?;
    let progress = printer.progress();
    progress.begin("training", missing.iter().map(|(_, config)| config.steps as u64).sum());
    missing.into_par_iter().try_for_each(|(key, config)| -> Result<(), StepError> {
        let directory = place(directory, key);
        let checkpoint = checkpoint(&directory, key);
        let trained = match device {
            None => train_one(config, task, Some(&checkpoint), &progress)?,
            Some(device) => torch::represent(config, task, &checkpoint, device, &progress)?,
        };
        write_encoder(&directory.join(ENCODER), &trained.encoder, BTreeMap::new())?;
        let record = TrainingRecord {
            key: key.clone(),
            config: *config,
            divergence: trained.divergence,
            points: trained.points,
            encoder: fingerprint_file(&directory.join(ENCODER))?,
        };
        write_sealed_json(&directory.join(RECORD), &record)?;
        Ok(checkpoint.remove()?)
    })
}

/// Returns the checkpoint file of the training of a candidate.
fn checkpoint(directory: &Path, key: &str) -> CheckpointFile {
    CheckpointFile::new(directory.join(CHECKPOINT), key.to_owned())
}

/// Removes every candidate and every interrupted training. Other files beside them are kept.
pub(super) fn remove(directory: &Path) -> Result<(), FileError> {
    remove_known(&directory.join(CANDIDATES), &mut is_ours)
}

/// Whether calib wrote this file of the candidates.
fn is_ours(path: &Path) -> bool {
    let folder = path.parent().and_then(Path::to_str).unwrap_or_default();
    let is_key = folder.len() == KEY_DIGITS && folder.bytes().all(|byte| byte.is_ascii_hexdigit());
    let is_named = [ENCODER, RECORD, CHECKPOINT].iter().any(|name| path.ends_with(name));
    is_key && (is_named || is_temporary(path))
}

/// Shortens a key to the name of a candidate's directory. It depends on the inputs, so that a growing grid keeps its
/// candidates.
fn short(key: &str) -> &str {
    &key[..KEY_DIGITS]
}

/// Whether the existing files of a candidate are as they were written. A representation that was taken over from
/// another model has no such files.
pub(super) fn is_whole(directory: &Path, candidate: &Candidate) -> bool {
    let Some(name) = &candidate.directory else { return true };
    let own = directory.join(CANDIDATES).join(name);
    !own.exists()
        || read_sealed_json(&own.join(RECORD))
            .is_ok_and(|record: TrainingRecord| read(&own, &record.key).is_some())
}

fn read(directory: &Path, key: &str) -> Option<TrainingRecord> {
    let record: TrainingRecord = read_sealed_json(&directory.join(RECORD)).ok()?;
    let encoder = fingerprint_file(&directory.join(ENCODER)).ok()?;
    (record.key == key && record.encoder == encoder).then_some(record)
}

fn finished(directory: &Path, key: &str) -> Result<(Candidate, Option<Mlp>), StepError> {
    let record: TrainingRecord = read_sealed_json(&directory.join(RECORD))?;
    let encoder = match record.divergence {
        Some(_) => None,
        None => Some(read_encoder(&directory.join(ENCODER))?),
    };
    let candidate = Candidate {
        config: Some(record.config),
        directory: Some(short(key).to_owned()),
        scores: None,
        divergence: record.divergence,
        points: record.points,
    };
    Ok((candidate, encoder))
}
