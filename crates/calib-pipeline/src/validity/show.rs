//! The judgement on the terminal.

use calib_agent::Part;
use calib_base::{
    StepError,
    output::{Printer, count, counted, percent, significant, table},
};
use calib_report::{Cell, Table};
use calib_validity::{CAP, FEWEST_PLANTS, Validity};

use super::{Judgement, Score, claims::findings, tables};

/// Print all tables.
pub(super) fn show(judgement: &Judgement, printer: &Printer) -> Result<(), StepError> {
    printer.result(&subtitle(judgement))?;
    for (number, score) in judgement.scores.iter().enumerate() {
        printer.result("")?;
        printer.result(&of_score(score))?;
        for table in tables::of_score(&score.validity) {
            print(&table, printer)?;
        }
        if number == 0 {
            printer.result("")?;
            for finding in findings(&score.validity) {
                printer.result(&finding)?;
            }
        }
    }
    printer.result("")?;
    for note in notes(judgement) {
        printer.result(&note)?;
    }
    Ok(())
}

fn print(of: &Table, printer: &Printer) -> Result<(), StepError> {
    printer.result("")?;
    printer.result(&of.title)?;
    let header: Vec<&str> = of.columns.iter().map(String::as_str).collect();
    let rows: Vec<Vec<String>> = of.rows.iter().map(|row| row.iter().map(text).collect()).collect();
    printer.lines(&table(&header, &rows))
}

fn text(cell: &Cell) -> String {
    match cell {
        Cell::Text(text) => text.clone(),
        Cell::Number(value) => significant(*value),
        Cell::Percent(share) => percent(*share),
        Cell::Count(value) => count(*value as usize),
        Cell::Setting(setting) => setting.to_string(),
        Cell::Missing => "–".to_owned(),
    }
}

/// What was judged, in a line.
pub(super) fn subtitle(judgement: &Judgement) -> String {
    let validity = judgement.first();
    let drawn = judgement.protocol.as_ref().map_or_else(String::new, |protocol| {
        format!("{}, plants and tasks drawn with the seed {}: ", protocol.file, protocol.seed)
    });
    format!(
        "{drawn}{} of {}, {} of the grid; intervals over plants",
        counted(validity.pairs, "plant–sensor pair"),
        counted(validity.plants.len(), "plant"),
        counted(validity.values.len(), "setting"),
    )
}

/// What a score is, in a line.
pub(super) fn of_score(Score { part, validity }: &Score) -> String {
    let scored = match part {
        Part::WholeRun => "By the errors of all steps",
        Part::AfterFirstQuarter => "By the errors after the first quarter",
        Part::FinalQuarter => "By the errors of the final quarter",
    };
    format!(
        "{scored}: {} of {}",
        counted(validity.pairs, "pair"),
        counted(validity.plants.len(), "plant")
    )
}

/// A part of a run, as in files.
pub(super) const fn part_name(part: Part) -> &'static str {
    match part {
        Part::WholeRun => "whole_run",
        Part::AfterFirstQuarter => "after_first_quarter",
        Part::FinalQuarter => "final_quarter",
    }
}

/// What is left out, and what the reader should know.
pub(super) fn notes(judgement: &Judgement) -> Vec<String> {
    let validity = judgement.first();
    let mut notes: Vec<String> = Vec::new();
    if !judgement.left_out.is_empty() {
        let each = judgement.left_out.iter().map(|of| format!("{}: {}", of.plant, of.reason));
        let all = judgement.left_out.len() + judgement.plants.len();
        let each = each.collect::<Vec<_>>().join("; ");
        notes.push(format!("{} of {all} plants are left out ({each})", judgement.left_out.len()));
    }
    notes.extend(judgement.missing.iter().cloned());
    notes.extend(
        validity
            .left_out
            .iter()
            .map(|pair| format!("{pair} is left out: every setting diverged on held-out data; add smaller learning rates to its sweep.grid")),
    );
    if validity.not_learnt > 0 {
        notes.push(format!(
            "in {} of {} pairs even the best setting predicts no better than the mean return, so the choice matters little there",
            validity.not_learnt, validity.pairs
        ));
    }
    notes.extend(capped(validity));
    if validity.plants.len() < FEWEST_PLANTS {
        notes.push(format!("intervals over plants need at least {FEWEST_PLANTS} of them"));
    }
    notes
}

/// How many regrets count as less than they are.
fn capped(validity: &Validity) -> Option<String> {
    let told = |of: &calib_validity::MethodSummary| {
        (of.capped > 0).then(|| format!("{} of {}", of.capped, of.method))
    };
    let each: Vec<String> = validity.methods.iter().filter_map(told).collect();
    (!each.is_empty()).then(|| {
        format!(
            "regrets above {} count as that, also of choices that diverged: {}",
            percent(CAP),
            each.join(", ")
        )
    })
}
