//! The report page of `validity`.

use std::{io::Write as _, path::Path};

use calib_base::StepError;
use calib_files::write_atomically;
use calib_report::{Overview, Table};

use super::{answer::JudgedStudies, claims::findings, figures, show, tables};

pub(super) fn write(path: &Path, judged: &JudgedStudies) -> Result<(), StepError> {
    let page = Overview {
        title: "Does calib choose well?".to_owned(),
        subtitle: Some(show::subtitle(judged)),
        decision: None,
        findings: findings(judged.validity()),
        warnings: show::notes(judged),
        texts: Vec::new(),
        figures: figures::all(judged).into_iter().map(|(_, figure)| figure).collect(),
        tables: all_tables(judged),
        command: judged.command.clone(),
    };
    let html = page.html();
    Ok(write_atomically(path, |file| file.write_all(html.as_bytes()))?)
}

/// Returns the tables of all scores. Those of the first score have plain titles, the others name
/// their score.
fn all_tables(judged: &JudgedStudies) -> Vec<Table> {
    let mut all = Vec::new();
    for (number, score) in judged.scores.iter().enumerate() {
        let own =
            tables::of_score(&score.validity).into_iter().chain([tables::each(&score.validity)]);
        all.extend(own.map(|table| match number {
            0 => table,
            _ => Table { title: format!("{}. {}", show::of_score(score), table.title), ..table },
        }));
        if number == 0 {
            all.push(tables::plants(&judged.plants));
        }
    }
    all
}
