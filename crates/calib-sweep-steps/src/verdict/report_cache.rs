//! Writes a report only when its content has changed, because drawing takes longer than judging.

use std::{
    path::{Path, PathBuf},
    time::SystemTime,
};

use calib_base::{
    Context as _, StepError,
    artefact::{self, Artefact, Below, DirectoryLock, Facts, MANIFEST, TOOL},
};
use calib_report::Report;
use calib_study::{Job, Scope, StepKind};
use serde::{Deserialize, Serialize};

/// `manifest.json` of the verdicts and figures of a study.
type ReportManifest = Artefact<ReportFacts>;

/// The facts about a report. The page beside the directory counts as one of its files.
#[derive(Serialize, Deserialize)]
struct ReportFacts {
    /// Fingerprint of all content of the report.
    key: String,
}

impl Facts for ReportFacts {
    const FORMAT: u32 = 1;
    const STEP: StepKind = StepKind::Evaluate;

    fn key(&self) -> &str {
        &self.key
    }
}

/// Whether a study was judged after the sweeps in `folders` were finished.
pub fn is_judged_since(job: &Job, folders: &[PathBuf]) -> bool {
    let directory = job.layout().evaluate();
    let judged = artefact::read::<ReportManifest>(&directory)
        .filter(|report| report.has_files(&directory))
        .and_then(|_| finished(&directory));
    judged.is_some_and(|judged| {
        folders.iter().all(|folder| finished(folder).is_some_and(|finished| finished <= judged))
    })
}

/// Returns when the step of a folder was finished.
fn finished(folder: &Path) -> Option<SystemTime> {
    folder.join(MANIFEST).metadata().and_then(|file| file.modified()).ok()
}

/// Calls `write` to write the figures and the `summary` of a report, and the page beside the directory. `write` returns
/// the file names in the directory. It is not called if the existing files show the same.
pub(crate) fn keep(
    job: &Job,
    report: &Report,
    summary: &impl Serialize,
    write: impl FnOnce() -> Result<Vec<String>, StepError>,
) -> Result<(), StepError> {
    let directory = job.layout().evaluate();
    // The debug format has all digits, as the report does.
    let key = artefact::key(&(ReportFacts::FORMAT, TOOL, format!("{report:?}"), summary))?;
    let page = job.layout().report();
    let page_name = page.file_name().map(|name| format!("../{}", name.to_string_lossy()));
    let kept = artefact::read::<ReportManifest>(&directory);
    let is_kept = kept.as_ref().is_some_and(|kept| kept.key == key && kept.is_whole(&directory));
    // A verdict older than its sweep would look unfinished, so it is written again.
    let parts = job.parts(Scope::Deployment)?;
    let sweeps = parts.iter().map(|part| part.layout().sweep());
    // Runs of other programs have no sweep.
    let sweeps: Vec<PathBuf> = sweeps.filter(|folder| folder.join(MANIFEST).exists()).collect();
    if is_kept && is_judged_since(job, &sweeps) && !job.policy().redoes() {
        return Ok(());
    }
    let mut claim = DirectoryLock::new(&directory, Below::Ours)?;
    if let Some(kept) = kept {
        // An earlier calib without such records also wrote the page.
        claim.record().add(kept.files.into_keys().filter(|name| name.starts_with("../")))?;
    }
    claim.record().note(page_name.clone())?;
    claim.begin()?;
    let written = write().with_context(|| not_written(&page))?;
    let names: Vec<String> = written.into_iter().chain(page_name).collect();
    claim.finish(ReportFacts { key }, names.iter().map(String::as_str)).map(drop)
}

/// Returns the message that a page cannot be written.
pub(super) fn not_written(page: &Path) -> String {
    format!(
        "{} cannot be written; if results were edited, the steps with --force make them again",
        page.display()
    )
}
