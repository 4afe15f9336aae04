//! Checks the accuracy of a model's tables.

use calib_base::{
    StepError, bail,
    outcome::Outcome,
    output::{Printer, count},
};
use calib_core::{Monitor, Seed};
use calib_files::fingerprint_file;
use calib_knn::{KnnError, KnnModel, Recall, faults, recall, verify};
use calib_study::{Job, StepKind, Study};

use crate::model::model_files;

/// Rows of each ensemble member on which the recall of approximate tables is measured.
const RECALL_ROWS: usize = 100;

/// Returns the recall of approximate tables, or `None` for exact ones.
pub(crate) fn recall_of(
    study: &Study,
    knn: &KnnModel,
    monitor: &dyn Monitor,
) -> Result<Option<Recall>, KnnError> {
    let approximate = !study.model.shortcuts().is_exact();
    let seed = Seed::new(study.seed).child("recall");
    approximate.then(|| recall(knn, RECALL_ROWS, seed, monitor)).transpose()
}

/// Returns the recall as text.
pub(crate) fn recall_line(recall: &Recall, k: usize) -> String {
    let [low, high] = recall.interval;
    let copies = match recall.copies_missed {
        0 => String::new(),
        missed => format!(
            ", and {} rows whose true one is at distance 0 have a farther one",
            count(missed)
        ),
    };
    format!(
        "approximate: recall@{k} {:.3} ({low:.3} to {high:.3}) by true distances, on {} rows; \
         neighbour {k} is {:.3} times as far as the true one{copies}",
        recall.recall,
        count(recall.rows),
        recall.distance_ratio,
    )
}

/// Searches some rows of each member by brute force, and reports whether the tables
/// agree.
pub(crate) fn check_against_brute_force(
    job: &Job,
    sample: usize,
    printer: &Printer,
) -> Result<Outcome, StepError> {
    let study = job.study();
    let paths = job.layout();
    let model = model_files::open(job)?;
    let Some(knn) = model.model.tables() else { bail!("the model has no neighbour tables") };
    let seed = Seed::new(study.seed).child("verify");
    for (name, written) in &model.manifest.files {
        let path = paths.model().join(name);
        if fingerprint_file(&path)? != *written {
            bail!(
                "{} is not what was written; run `{} --force`",
                path.display(),
                job.command(StepKind::BuildModel)
            );
        }
    }
    let progress = printer.progress();
    let shortcuts = study.model.shortcuts();
    if !shortcuts.is_exact() {
        let seed = seed.child("approximate");
        let found = faults(knn, shortcuts, sample, seed);
        if let Some((member, transition, fault)) = found.first() {
            drop(progress);
            printer.error(&format!(
                "{} of the checked rows cannot be what a search found, the first of them row {} of ensemble member {member}: {fault}; this is a bug in calib, please report it",
                found.len(),
                transition.0
            ));
            return Ok(Outcome::Faulty);
        }
        let recall = recall(knn, sample, seed, &progress)?;
        drop(progress);
        printer.say(&format!(
            "verified: the lists of {} rows have the distances of their states, in order, to states that may be neighbours",
            count(recall.rows)
        ));
        printer.say(&recall_line(&recall, knn.k()));
        return Ok(Outcome::Done);
    }
    let verification = verify(knn, sample, seed, &progress)?;
    drop(progress);
    if !verification.agrees() {
        printer.error(&format!(
            "{} of {} checked rows differ from brute force: this is a bug in calib, please report it",
            verification.different.len(),
            verification.rows
        ));
        return Ok(Outcome::Faulty);
    }
    printer.say(&format!("verified: {} rows agree with brute force", count(verification.rows)));
    Ok(Outcome::Done)
}
