//! The page.

use std::{io::Write as _, path::Path};

use calib_files::write_atomically;
use calib_report::Overview;

use super::{Judgement, figures, show};

/// Write the page.
pub(super) fn write(path: &Path, judgement: &Judgement) -> anyhow::Result<()> {
    let validity = &judgement.validity;
    let left_out =
        validity.left_out.iter().map(|pair| format!("{pair}: every value diverged Online"));
    let mut warnings: Vec<String> = judgement.missing.iter().cloned().chain(left_out).collect();
    if validity.plants.len() < 2 {
        warnings.push("one plant alone: there are no intervals over plants".to_owned());
    }
    let page = Overview {
        title: "Does calib choose well?".to_owned(),
        subtitle: Some(show::subtitle(judgement)),
        findings: show::findings(judgement),
        warnings,
        figures: figures::all(judgement).into_iter().map(|(_, figure)| figure).collect(),
        tables: show::tables(judgement),
        command: judgement.command.clone(),
    };
    let html = page.html();
    Ok(write_atomically(path, |file| file.write_all(html.as_bytes()))?)
}
