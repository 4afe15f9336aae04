//! Judging runs that something else made.

use std::path::Path;

use anyhow::ensure;
use calib_core::{Period, Seed};
use calib_files::write_json;
use calib_report::caveats;
use calib_study::Study;
use calib_sweep::{Candidate, EnvironmentId, Judging, Span, verdict};

use super::read::{Runs, read};
use crate::{
    base::{artefact::TOOL, outcome::Outcome},
    output::Printer,
    rollouts::figures,
    sweep::SweepManifest,
    verdict::{
        evaluate::{self, Summary},
        verdict_rows::{self, sensitivity, verdict_row},
    },
};

/// Judge the runs in the table at `path` by the `[evaluate]` of `study`, and write `summary.json` and figures to `output`, if it is given.
pub(crate) fn run(
    path: &Path,
    study: &Study,
    output: Option<&Path>,
    printer: &Printer,
) -> anyhow::Result<Outcome> {
    let part = study.part();
    let Runs { sensors, candidates, results } = read(path, part)?;
    let sweep = manifest(study, candidates);
    let judging = Judging {
        part,
        rule: study.evaluate.rule,
        top_k: study.evaluate.top_k,
        scales: &[],
        resamples: study.evaluate.resamples,
        seed: Seed::new(study.seed).child("verdict"),
    };
    let mut verdicts = Vec::new();
    for sensor in &sensors {
        let in_members = results.iter().any(|of| {
            of.unit.sensor == *sensor && matches!(of.unit.environment, EnvironmentId::Member(_))
        });
        ensure!(
            in_members,
            "{}: sensor {sensor} has no run in a member of a model, such as \"member:0\"",
            path.display()
        );
        verdicts.push(verdict(sensor, &sweep.candidates, &results, &judging)?);
    }
    let rows: Vec<calib_report::Verdict> =
        verdicts.iter().map(|verdict| verdict_row(verdict, &sweep, study)).collect();
    let title = study.evaluate.title.clone();
    let stem = || path.file_stem().map_or_else(String::new, |of| of.to_string_lossy().into_owned());
    let summary = Summary {
        format: 2,
        tool: TOOL,
        title: title.unwrap_or_else(stem),
        choices: evaluate::choices(&verdicts, &sweep.candidates),
        advice: rows.iter().map(verdict_rows::advice).collect(),
        caveats: caveats(&rows),
        candidates: sweep.candidates.iter().map(Candidate::label).collect(),
        verdicts,
        notes: Vec::new(),
    };
    if let Some(directory) = output {
        write(directory, &summary, &sweep, study)?;
    }
    if printer.is_for_machines() {
        printer.json(&summary)?;
    } else {
        evaluate::print_advice(&summary, printer)?;
        evaluate::print_notes(&summary.caveats, printer)?;
    }
    Ok(evaluate::told(&summary))
}

fn write(
    directory: &Path,
    summary: &Summary,
    sweep: &SweepManifest,
    study: &Study,
) -> anyhow::Result<()> {
    calib_files::create_directory(directory)?;
    let figures = directory.join("figures");
    calib_files::create_directory(&figures)?;
    for verdict in &summary.verdicts {
        let figure = sensitivity(verdict, &sweep.candidates, study.model_name()).figure()?;
        figures::write(&figures, &format!("sensitivity-{}", verdict.sensor), &figure)?;
    }
    Ok(write_json(&directory.join("summary.json"), summary)?)
}

/// Of a sweep that calib did not make.
fn manifest(study: &Study, candidates: Vec<Candidate>) -> SweepManifest {
    let second = Period::from_micros(1_000_000);
    let period = second.unwrap_or_else(|| unreachable!("a second is positive"));
    let span = Span { steps: study.sweep.steps, tail: 1 };
    SweepManifest::of_no_data(study, period, span, candidates)
}
