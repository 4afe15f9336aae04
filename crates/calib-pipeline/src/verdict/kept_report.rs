//! A report is written when what it shows has changed, and not otherwise: drawing takes longer than judging.

use std::{fs, path::Path};

use anyhow::Context as _;
use calib_report::Report;
use calib_study::Job;
use serde::{Deserialize, Serialize};

use crate::base::artefact::{self, Below, Claim, Files, MANIFEST, Manifest, TOOL};

/// `manifest.json` of the verdicts and figures of a study.
#[derive(Serialize, Deserialize)]
struct ReportManifest {
    format: u32,
    tool: String,
    /// Fingerprint of all that the report shows.
    key: String,
    /// Fingerprint of every other file, the page beside the directory among them.
    files: Files,
}

impl Manifest for ReportManifest {
    const FORMAT: u32 = 1;

    fn format(&self) -> u32 {
        self.format
    }
}

/// Let `write` write the page, the figures and the `summary` of a report, unless they are there and show the same.
pub(crate) fn keep(
    job: &Job,
    report: &Report,
    summary: &impl Serialize,
    write: impl FnOnce() -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let directory = job.layout().evaluate();
    // Rows of a report are shown to the last digit, and so are they here.
    let key = artefact::key(&(ReportManifest::FORMAT, TOOL, format!("{report:?}"), summary))?;
    let kept = artefact::read::<ReportManifest>(&directory)
        .is_some_and(|kept| kept.key == key && artefact::are_whole(&directory, &kept.files));
    if kept && !job.policy().redoes() {
        return Ok(());
    }
    let claim = Claim::new(&directory, Below::Ours)?;
    claim.begin()?;
    write().with_context(|| {
        let page = job.layout().report();
        format!(
            "{} cannot be written; if results were edited, the steps with --force make them again",
            page.display()
        )
    })?;
    let page = job.layout().report();
    let page = page.file_name().map(|name| format!("../{}", name.to_string_lossy()));
    let names: Vec<String> = files(&directory, "")?.into_iter().chain(page).collect();
    let files = artefact::fingerprints(&directory, names.iter().map(String::as_str))?;
    let format = ReportManifest::FORMAT;
    claim.complete(&ReportManifest { format, tool: TOOL.to_owned(), key, files })
}

/// Names of all files below `directory` but its own manifest, hidden ones left out.
fn files(directory: &Path, before: &str) -> anyhow::Result<Vec<String>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(directory)? {
        let entry = entry?;
        let Ok(name) = entry.file_name().into_string() else { continue };
        if name.starts_with('.') || (before.is_empty() && name == MANIFEST) {
            continue;
        }
        let shown = format!("{before}{name}");
        if entry.file_type()?.is_dir() {
            found.extend(files(&entry.path(), &format!("{shown}/"))?);
        } else {
            found.push(shown);
        }
    }
    found.sort();
    Ok(found)
}
