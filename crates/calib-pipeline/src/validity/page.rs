//! The page.

use std::{io::Write as _, path::Path};

use calib_base::StepError;
use calib_files::write_atomically;
use calib_report::{Overview, Table};

use super::{Judgement, claims::findings, figures, show, tables};

/// Write the page.
pub(super) fn write(path: &Path, judgement: &Judgement) -> Result<(), StepError> {
    let page = Overview {
        title: "Does calib choose well?".to_owned(),
        subtitle: Some(show::subtitle(judgement)),
        decision: None,
        findings: findings(judgement.first()),
        warnings: show::notes(judgement),
        figures: figures::all(judgement).into_iter().map(|(_, figure)| figure).collect(),
        tables: all_tables(judgement),
        command: judgement.command.clone(),
    };
    let html = page.html();
    Ok(write_atomically(path, |file| file.write_all(html.as_bytes()))?)
}

/// By the first score under their own titles, by another one under what it is.
fn all_tables(judgement: &Judgement) -> Vec<Table> {
    let mut all = Vec::new();
    for (number, score) in judgement.scores.iter().enumerate() {
        let own =
            tables::of_score(&score.validity).into_iter().chain([tables::each(&score.validity)]);
        all.extend(own.map(|table| match number {
            0 => table,
            _ => Table { title: format!("{}. {}", show::of_score(score), table.title), ..table },
        }));
        if number == 0 {
            all.push(tables::plants(&judgement.plants));
        }
    }
    all
}
