//! Tables of the candidates: as files, on the terminal, and in the report.

use std::path::Path;

use calib_base::{
    StepError, artefact,
    output::{Printer, number, table},
};
use calib_data::table::Table;
use calib_report::{Best, Cell, Table as ReportTable};
use calib_represent::{LEAST_UNIQUENESS, LaplacianConfig, RepresentationKind, Scores};

use super::{candidate::Candidate, manifest::RepresentationManifest};

/// A hyperparameter: its name as in a study, and its value.
type Field = (&'static str, fn(&LaplacianConfig) -> f64);

const FIELDS: [Field; 11] = [
    ("attraction", |config| config.loss.attraction),
    ("beta", |config| config.loss.beta),
    ("zeta", |config| config.loss.zeta),
    ("kappa", |config| config.kappa),
    ("trajectory", |config| config.trajectory as f64),
    ("dimension", |config| config.dimension as f64),
    ("hidden_layers", |config| config.hidden_layers as f64),
    ("hidden_units", |config| config.hidden_units as f64),
    ("learning_rate", |config| config.learning_rate),
    ("batch_size", |config| config.batch_size as f64),
    ("steps", |config| config.steps as f64),
];

/// Returns a score of each candidate.
fn score(candidates: &[Candidate], value: fn(&Scores) -> f64) -> Vec<Option<f64>> {
    candidates.iter().map(|candidate| candidate.scores.as_ref().map(value)).collect()
}

/// Writes `candidates.parquet`, one row per candidate, and `curves.parquet`, one row per point of a
/// learning curve.
pub(super) fn write(
    directory: &Path,
    candidates: &[Candidate],
    chosen: Option<usize>,
) -> Result<(), StepError> {
    let mut table = Table::new()
        .with("candidate", (0..candidates.len() as u32).collect::<Vec<u32>>())
        .with("chosen", (0..candidates.len()).map(|at| Some(at) == chosen).collect())
        .with_optional(
            "form",
            candidates
                .iter()
                .map(|candidate| Some(format!("{:?}", candidate.config?.loss.form)))
                .collect(),
        );
    for (name, value) in FIELDS {
        let values = candidates.iter().map(|candidate| candidate.config.as_ref().map(value));
        table = table.with_optional(name, values.collect());
    }
    let table = table
        .with_optional("dynamics_awareness", score(candidates, |scores| scores.dynamics_awareness))
        .with_optional("uniqueness", score(candidates, |scores| scores.uniqueness))
        .with_optional("live_dimensions", score(candidates, |scores| scores.live_dimensions as f64))
        .with_optional(
            "successive_distance",
            score(candidates, |scores| scores.successive_distance),
        )
        .with_optional("random_distance", score(candidates, |scores| scores.random_distance))
        .with_optional(
            "loss",
            candidates.iter().map(|candidate| Some(candidate.points.last()?.loss)).collect(),
        )
        .with_optional(
            "divergence",
            candidates.iter().map(|candidate| Some(candidate.divergence?.to_string())).collect(),
        )
        .with_optional(
            "directory",
            candidates.iter().map(|candidate| candidate.directory.clone()).collect(),
        );
    artefact::write_table(table, &directory.join("candidates.parquet"))?;
    let points: Vec<_> = candidates
        .iter()
        .enumerate()
        .flat_map(|(number, candidate)| {
            candidate.points.iter().map(move |point| (number as u32, point))
        })
        .collect();
    let curves = Table::new()
        .with("candidate", points.iter().map(|(number, _)| *number).collect())
        .with("step", points.iter().map(|(_, point)| point.step as u32).collect())
        .with("loss", points.iter().map(|(_, point)| point.loss).collect())
        .with(
            "dynamics_awareness",
            points.iter().map(|(_, point)| point.scores.dynamics_awareness).collect(),
        )
        .with("uniqueness", points.iter().map(|(_, point)| point.scores.uniqueness).collect())
        .with(
            "live_dimensions",
            points.iter().map(|(_, point)| point.scores.live_dimensions as u32).collect(),
        );
    artefact::write_table(curves, &directory.join("curves.parquet"))
}

/// Returns the hyperparameters in which the candidates differ, or otherwise the most interesting ones.
fn telling(candidates: &[Candidate]) -> Vec<Field> {
    FIELDS
        .into_iter()
        .filter(|(_, value)| {
            let mut values =
                candidates.iter().filter_map(|candidate| candidate.config.as_ref().map(value));
            values.next().is_some_and(|first| values.any(|other| other != first))
        })
        .collect()
}

/// Prints all candidates with both scores, and the chosen one.
pub(crate) fn show(manifest: &RepresentationManifest, printer: &Printer) -> Result<(), StepError> {
    let fields = telling(&manifest.candidates);
    let mut header = vec!["candidate"];
    header.extend(fields.iter().map(|(name, _)| *name));
    header.extend(["awareness", "uniqueness", "live dims", "loss", ""]);
    let rows: Vec<Vec<String>> = manifest
        .candidates
        .iter()
        .enumerate()
        .map(|(place, candidate)| {
            let mut row = vec![place.to_string()];
            row.extend(fields.iter().map(|(_, value)| {
                candidate.config.as_ref().map_or_else(String::new, |config| plain(value(config)))
            }));
            match &candidate.scores {
                Some(scores) => row.extend([
                    format!("{:.3}", scores.dynamics_awareness),
                    format!("{:.3}", scores.uniqueness),
                    scores.live_dimensions.to_string(),
                    candidate.points.last().map_or_else(String::new, |point| number(point.loss)),
                ]),
                None => row.extend([const { String::new() }; 4]),
            }
            row.push(verdict(place, candidate, manifest.chosen));
            row
        })
        .collect();
    printer.lines(&table(&header, &rows))
}

fn verdict(number: usize, candidate: &Candidate, chosen: Option<usize>) -> String {
    match (&candidate.scores, &candidate.divergence) {
        (_, Some(divergence)) => format!("diverged: {divergence}"),
        (None, None) => "diverged: not finite".to_owned(),
        _ if Some(number) == chosen => "chosen".to_owned(),
        (Some(scores), None) if scores.uniqueness <= LEAST_UNIQUENESS => {
            format!("uniqueness not above {LEAST_UNIQUENESS}")
        }
        _ => String::new(),
    }
}

/// Formats a hyperparameter as in a study.
fn plain(value: f64) -> String {
    if value == 0.0 || (1e-3..1e7).contains(&value.abs()) {
        value.to_string()
    } else {
        format!("{value:e}")
    }
}

/// Returns the candidates for the report.
pub fn report_table(manifest: &RepresentationManifest) -> ReportTable {
    let fields = telling(&manifest.candidates);
    let columns = ["candidate"].into_iter().chain(fields.iter().map(|(name, _)| *name));
    let columns = columns.chain([
        "dynamics awareness",
        "uniqueness",
        "live dimensions",
        "loss at the end",
        "verdict",
    ]);
    let rows = manifest.candidates.iter().enumerate().map(|(place, candidate)| {
        let mut row = vec![Cell::Text(place.to_string())];
        row.extend(fields.iter().map(|(_, value)| {
            candidate
                .config
                .as_ref()
                .map_or(Cell::Missing, |config| Cell::Text(plain(value(config))))
        }));
        match &candidate.scores {
            Some(scores) => row.extend([
                Cell::Number(scores.dynamics_awareness),
                Cell::Number(scores.uniqueness),
                Cell::Count(scores.live_dimensions as u64),
                candidate
                    .points
                    .last()
                    .map_or(Cell::Missing, |point| Cell::Text(number(point.loss))),
            ]),
            None => row.extend([const { Cell::Missing }; 4]),
        }
        row.push(Cell::Text(verdict(place, candidate, manifest.chosen)));
        row
    });
    let imported = manifest.study.representation.kind == RepresentationKind::Import;
    ReportTable {
        title: "Representations".to_owned(),
        caption: format!(
            "Scored on the last {} training states{}. calib uses the one with the highest \
             dynamics awareness of those with a uniqueness above {LEAST_UNIQUENESS}. Bold: the largest of a column; \
             scores have no intervals, so small differences may be chance.",
            calib_core::count(manifest.validation_rows as u64),
            // The training data of an imported one are not known.
            if imported { "" } else { ", which they were not trained on" },
        ),
        columns: columns.map(str::to_owned).collect(),
        rows: rows.collect(),
        best: Some(Best::LargestOfColumn),
    }
    .without_empty_columns()
}
