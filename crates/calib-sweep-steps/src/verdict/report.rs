//! Assembles the report: results as typed rows for the page.

use std::{io::Write as _, path::Path};

use calib_base::{
    Context as _, StepError,
    artefact::{self, Below},
};
use calib_core::Monitor;
use calib_data::table::read_parquet_columns;
use calib_files::{write_atomically, write_json};
use calib_model_steps::{
    model::{
        built_model, jumps as jump_text,
        model_files::{self, ModelManifest},
        recurrence,
    },
    represent::{self, RepresentationManifest},
    rollouts::{
        collapse,
        comparison::{self, ComparedModel},
        figures::{self, FirstRollouts},
        one_step::{self, OneStepModel},
        rollout::{self, RolloutManifest},
        trajectory_columns::Columns,
    },
};
use calib_report::{Cell, JumpStatistics, Report, Reproduction, RolloutFigure, Sensitivity, Table};
use calib_represent::RepresentationKind;
use calib_study::{Job, Layout, StepKind, Study};
use calib_sweep::Rule;

use crate::{
    sweep::SweepFacts,
    verdict::{
        described::Descriptions,
        judged::{Judged, Summary},
        learned::Learned,
        learning, report_cache,
        report_data::{data_profile, subtitle},
        verdict_rows,
    },
};

/// Writes the summary, the figures and `report.html`, unless the existing ones show the same.
pub(crate) fn write(
    job: &Job,
    report: &Report,
    summary: &Summary,
    monitor: &dyn Monitor,
) -> Result<(), StepError> {
    report_cache::keep(job, report, summary, || write_all(job.layout(), report, summary, monitor))
}

fn write_all(
    paths: &Layout,
    report: &Report,
    summary: &Summary,
    monitor: &dyn Monitor,
) -> Result<Vec<String>, StepError> {
    write_json(&paths.evaluate().join(SUMMARY), summary)?;
    let directory = paths.evaluate().join(FIGURES);
    let mut written = write_comparisons(&directory, report)?;
    let names_of =
        figures::placed(report.sensitivities.iter().map(|figure| figure.sensor.as_str()));
    for (sensitivity, name) in report.sensitivities.iter().zip(names_of) {
        monitor.check()?;
        let name = format!("sensitivity-{name}");
        written.extend(figures::write(&directory, &name, &sensitivity.figure()?)?);
    }
    let names_of = figures::placed(report.learning.iter().map(|figure| figure.sensor.as_str()));
    for (curves, name) in report.learning.iter().zip(names_of) {
        monitor.check()?;
        let name = format!("learning-{name}-{}", curves.environment.file_name());
        written.extend(figures::write(&directory, &name, &curves.figure()?)?);
    }
    let names_of = figures::placed(report.rollouts.iter().map(|figure| figure.sensor.as_str()));
    for (rollout, name) in report.rollouts.iter().zip(names_of) {
        monitor.check()?;
        let name = format!("rollout-{name}");
        written.extend(figures::write(&directory, &name, &rollout.figure()?)?);
    }
    write_page(paths, report)?;
    Ok(names(written))
}

/// The file beside the figures.
pub(crate) const SUMMARY: &str = "summary.json";
/// The folder of the figures.
pub(crate) const FIGURES: &str = "figures";

/// Returns the names of the summary and of these figures.
pub(crate) fn names(figures: Vec<String>) -> Vec<String> {
    let figures = figures.into_iter().map(|name| format!("{FIGURES}/{name}"));
    figures.chain([SUMMARY.to_owned()]).collect()
}

/// Writes `report.html`.
pub(crate) fn write_page(paths: &Layout, report: &Report) -> Result<(), StepError> {
    let html = report.html()?;
    if let Some(directory) = paths.report().parent().filter(|directory| directory.is_dir()) {
        calib_files::remove_temporaries(directory, Below::Unknown)?;
    }
    Ok(write_atomically(&paths.report(), |file| file.write_all(html.as_bytes()))?)
}

/// Writes the figures with all sensors, or all models, side by side. Returns the file names.
pub(crate) fn write_comparisons(
    directory: &Path,
    report: &Report,
) -> Result<Vec<String>, StepError> {
    let mut written = Vec::new();
    if !report.sensitivities.is_empty() {
        let panels = Sensitivity::panels(&report.sensitivities)?;
        written.extend(figures::write(directory, "sensitivity", &panels)?);
    }
    let names = figures::placed(report.recorded.iter().map(|figure| figure.sensor.as_str()));
    for (recorded, name) in report.recorded.iter().zip(names) {
        let name = format!("recorded-{name}");
        written.extend(figures::write(directory, &name, &recorded.figure()?)?);
    }
    let names = figures::placed(report.rollout_grids.iter().map(|grid| grid.sensor.as_str()));
    for (grid, name) in report.rollout_grids.iter().zip(names) {
        written.extend(figures::write(directory, &format!("rollouts-{name}"), &grid.figure()?)?);
    }
    Ok(written)
}

/// Assembles the report on a finished sweep and its model.
pub(crate) fn assemble(judged: &Judged) -> Result<Report, StepError> {
    assembled(judged).with_context(|| report_cache::not_written(&judged.paths().report()))
}

fn assembled(judged: &Judged) -> Result<Report, StepError> {
    let Judged { job, manifest: sweep, summary, results, .. } = judged;
    let study = job.study();
    let paths = job.layout();
    let name = job.model_name();
    let learned = Learned::of(job, sweep)?;
    let model = learned.model.as_ref();
    let content = model.map(model_files::content).transpose()?;
    let rollouts = rollout::finished(job, content.as_deref())?;
    let descriptions = Descriptions::of(job, &learned.profile)?;
    let (shown, mut starts) = match &rollouts {
        Some(rollouts) => rollout_figures(paths, rollouts)?,
        None => (Vec::new(), Vec::new()),
    };
    for own in &mut starts {
        own.unit = descriptions.words(&own.sensor);
    }
    let grids = starts.iter().flat_map(|own| figures::grids(&[(name, own)]));
    let mut report = Report {
        title: summary.title.clone(),
        subtitle: Some(subtitle(&learned, judged)),
        predicts: summary.predicts.clone(),
        decision: None,
        verdicts: judged.rows.clone(),
        warnings: [summary.notes.clone(), warnings_of_model(study, model)].concat(),
        sensitivities: summary
            .verdicts
            .iter()
            .map(|verdict| verdict_rows::sensitivity(verdict, sweep, name))
            .collect(),
        learning: learning::curves(job, &sweep.candidates, results)?,
        recorded: judged.recorded.clone(),
        rollouts: shown,
        rollout_grids: grids.collect(),
        jumps: model.map_or_else(Vec::new, |model| jumps(name, model, study.sweep.steps)),
        tables: tables(job, model, rollouts.as_ref())?,
        data: Some(data_profile(&learned, judged)),
        reproduction: reproduction(job, &steps(&[study]), sweep)?,
    };
    descriptions.put_into(&mut report);
    Ok(report)
}

/// Returns warnings about the model, if the choice depends on it.
fn warnings_of_model(study: &Study, model: Option<&ModelManifest>) -> Vec<String> {
    let model = model.filter(|_| study.evaluate.rule != Rule::LogReplay);
    model.map_or_else(Vec::new, |model| built_model::warnings(model))
}

/// Returns tables of the rollouts and of the available representations.
fn tables(
    job: &Job,
    model: Option<&ModelManifest>,
    rollouts: Option<&RolloutManifest>,
) -> Result<Vec<Table>, StepError> {
    let study = job.study();
    let paths = job.layout();
    let name = job.model_name();
    let mut tables = Vec::new();
    if let Some(rollouts) = rollouts {
        tables.extend(collapse::report_table(name, &rollouts.collapse));
        let one_step = OneStepModel::read(name, job, &rollouts.model)?;
        tables.extend(one_step::report_tables(&one_step.iter().collect::<Vec<_>>())?);
        let members = rollouts.members.len();
        // With a single model, only the means are shown.
        let compared = rollouts.comparison.as_ref();
        let compared = compared.map(|own| ComparedModel::new(name, members, own, &[]));
        tables.extend(comparison::report_tables(compared.as_slice())?);
        tables.extend(starts_table(name, rollouts));
    }
    tables.extend(model.and_then(recurrence::report_table));
    tables.extend(representation_table(study, paths));
    Ok(tables)
}

/// Returns a table of how many start states each member lacks, and of the distance to their replacements.
/// `None` if none is missing.
pub(crate) fn starts_table(model: &str, rollouts: &RolloutManifest) -> Option<Table> {
    let all = rollouts.members.iter().map(|member| &member.starts);
    if all.clone().all(|starts| starts.mean_distance.is_none()) {
        return None;
    }
    let rows = all.enumerate().map(|(member, starts)| {
        vec![
            Cell::Text(format!("ensemble member {member}")),
            Cell::Count(starts.starts as u64),
            Cell::Count(starts.replaced as u64),
            starts.mean_distance.into(),
            starts.largest_distance.into(),
        ]
    });
    let columns = ["", "start states", "in the block left out", "mean distance", "largest"];
    Some(Table {
        title: "Start states".to_owned(),
        caption: format!(
            "{model}: each ensemble member lacks one block of the log. A start state in that block, or one of the held-out period, is replaced by the nearest state that the ensemble member has. Distances are from the state that was asked for to the one that replaces it, in the metric of the model."
        ),
        columns: columns.map(str::to_owned).to_vec(),
        rows: rows.collect(),
        best: None,
    })
}

/// Returns a table of the available representations, if the study has any.
pub(crate) fn representation_table(study: &Study, paths: &Layout) -> Option<Table> {
    (study.has_model() && study.representation.kind != RepresentationKind::None)
        .then(|| artefact::read::<RepresentationManifest>(&paths.representation()))
        .flatten()
        .map(|manifest| represent::report_table(&manifest))
}

/// Returns figures of the rollouts over the recorded log, and of all their starts.
pub(crate) fn rollout_figures(
    paths: &Layout,
    manifest: &RolloutManifest,
) -> Result<(Vec<RolloutFigure>, Vec<FirstRollouts>), StepError> {
    let mut columns =
        ["member", "rollout", "wanted_row", "wanted_timestamp"].map(str::to_owned).to_vec();
    let of_sensors = Columns::of(&manifest.sensors).into_iter();
    columns.extend(of_sensors.flat_map(|named| [named.physical, named.recorded]));
    let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
    let path = paths.rollout().join("trajectories.parquet");
    let trajectories = read_parquet_columns(&path, &columns)?;
    let sensors = &manifest.sensors;
    let period_secs = manifest.period_secs;
    let shown = figures::rollouts(&trajectories, sensors, period_secs)?;
    Ok((shown, figures::starts(&trajectories, sensors, period_secs)?))
}

fn jumps(name: &str, model: &ModelManifest, run: usize) -> Vec<JumpStatistics> {
    let members = model.members.iter().enumerate();
    members
        .filter_map(|(member, summary)| {
            let jumps = summary.jumps.as_ref()?;
            Some(JumpStatistics {
                model: name.to_owned(),
                member,
                steps: jumps.steps as u64,
                jump_rate: jumps.jump_rate,
                departure_rate: jumps.departure_rate,
                mean_run_length: jumps.mean_run_length,
                note: jump_text::note(jumps, summary.transitions, run).map(str::to_owned),
            })
        })
        .collect()
}

/// Returns the steps that make the report of studies that differ only in their models. The step that makes
/// the log is not included.
pub fn steps(models: &[&Study]) -> Vec<StepKind> {
    let made_of_log = StepKind::ALL.into_iter().filter(|step| *step > StepKind::Prepare);
    made_of_log.filter(|step| models.iter().any(|study| study.needs(*step))).collect()
}

fn reproduction(
    job: &Job,
    steps: &[StepKind],
    sweep: &SweepFacts,
) -> Result<Reproduction, StepError> {
    let written = job.whole()?;
    let laid_over = job.profile().map_or_else(String::new, |name| {
        format!("# with [profiles.{name}] laid over the rest: as a file of its own it is run without --profile\n")
    });
    Ok(Reproduction {
        command: command_lines(job, steps, sweep),
        study_toml: laid_over + &toml::to_string(&written)?,
        versions: vec![("calib".to_owned(), env!("CARGO_PKG_VERSION").to_owned())],
        seeds: vec![("study".to_owned(), written.seed)],
        fingerprint: sweep.data.to_string(),
    })
}

/// Returns the commands to type, one per line.
pub(crate) fn command_lines(job: &Job, steps: &[StepKind], sweep: &SweepFacts) -> String {
    let lines = steps.iter().map(|step| match step {
        StepKind::Sweep => sweep.again(&job.reproduction(*step)),
        step => job.reproduction(*step),
    });
    lines.collect::<Vec<_>>().join("\n")
}
