//! Judges runs that another program made.

use std::{collections::BTreeSet, io::Write as _, path::Path};

use calib_base::{
    Context as _, StepError,
    artefact::{Below, DirectoryLock},
    ensure,
};
use calib_core::Period;
use calib_files::{Fingerprint, fingerprint_file, write_atomically, write_json};
use calib_model_steps::rollouts::figures;
use calib_report::{Report, Reproduction};
use calib_study::Study;
use calib_sweep::{Candidate, EnvironmentId, Rule, Span, UnitResult, verdict};

use super::read::{Runs, read};
use crate::{
    sweep::{
        SweepFacts,
        simple::{self, SimpleErrors},
    },
    verdict::{
        evaluate::{Judgement, judging},
        judged::Summary,
        report::{FIGURES, SUMMARY},
        verdict_rows::{sensitivity, verdict_row},
    },
};

/// Judges the runs in the table at `path` by the `[evaluate]` section of `study`. If `output` is given, writes
/// `summary.json`, figures and `report.html` there.
///
/// # Errors
/// Returns an error if the table cannot be read, lacks a column or has too few runs for the rule, or if a file cannot
/// be written.
pub fn run(path: &Path, study: &Study, output: Option<&Path>) -> Result<Judgement, StepError> {
    let part = study.part();
    let Runs { sensors, candidates, results } = read(path, part)?;
    let mut sweep = manifest(study, candidates);
    sweep.simple = simple_beside(path)?;
    let mut verdicts = Vec::new();
    for sensor in &sensors {
        let judging = judging(study, part, &sweep, sensor);
        check_evidence(sensor, &results, judging.rule)
            .with_context(|| path.display().to_string())?;
        verdicts.push(verdict(sensor, &sweep.candidates, &results, &judging)?);
    }
    let rows: Vec<calib_report::Verdict> = verdicts
        .iter()
        .map(|verdict| verdict_row(verdict, None, &sweep, study, study.model_name()))
        .collect();
    let title = study.evaluate.title.clone().unwrap_or_else(|| {
        path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned())
    });
    let summary = Summary::new(title, verdicts, &rows, &sweep.candidates);
    if let Some(directory) = output {
        let report = report(&summary, rows, &sweep, study, path)?;
        write(directory, &summary, &report)?;
    }
    Ok(Judgement { summary, report: output.map(|directory| directory.join(REPORT)) })
}

/// Checks that a sensor has runs of the kind that the rule uses.
fn check_evidence(sensor: &str, results: &[UnitResult], rule: Rule) -> Result<(), StepError> {
    let own = results.iter().filter(|result| result.unit.sensor == *sensor);
    let environments: BTreeSet<EnvironmentId> = own.map(|result| result.unit.environment).collect();
    let has_members =
        environments.iter().any(|environment| matches!(environment, EnvironmentId::Member(_)));
    let has_log = environments.contains(&EnvironmentId::LogReplay);
    ensure!(
        has_members || has_log || !rule.works_without_model(),
        "sensor {sensor} has no run on the replayed log, \"log-replay\", nor in a member of a model, such as \"member:0\""
    );
    ensure!(
        has_members || rule.works_without_model(),
        "sensor {sensor} has no run in a member of a model, such as \"member:0\"{}",
        if has_log { "; without a model set evaluate.rule = \"log_replay\"" } else { "" }
    );
    Ok(())
}

/// Returns the errors of simple predictors on the windows of these runs, if calib wrote both files.
fn simple_beside(path: &Path) -> Result<SimpleErrors, StepError> {
    let folder = path.parent().unwrap_or(Path::new(""));
    if !folder.join(simple::FILE).is_file() {
        return Ok(SimpleErrors::default());
    }
    let beside = SimpleErrors::read(folder)?;
    let is_of_these = beside.runs.is_some() && beside.runs == fingerprint_file(path).ok();
    Ok(if is_of_these { beside } else { SimpleErrors::default() })
}

/// The report page beside the summary.
const REPORT: &str = "report.html";

/// Returns the report on runs of another program: errors by setting, and the verdicts.
fn report(
    summary: &Summary,
    verdicts: Vec<calib_report::Verdict>,
    sweep: &SweepFacts,
    study: &Study,
    path: &Path,
) -> Result<Report, StepError> {
    let verdicts_of_sensors = summary.verdicts.iter();
    Ok(Report {
        title: summary.title.clone(),
        subtitle: Some(format!("Runs of {}, which calib did not make.", path.display())),
        verdicts,
        sensitivities: verdicts_of_sensors
            .map(|verdict| sensitivity(verdict, sweep, study.model_name()))
            .collect(),
        reproduction: reproduction(path, study)?,
        ..Report::default()
    })
}

fn reproduction(path: &Path, study: &Study) -> Result<Reproduction, StepError> {
    let runs = calib_study::shell_words([path.display().to_string()]);
    // The fingerprint is that of the current file. A pipe cannot be read twice, so it has none.
    let fingerprint =
        fingerprint_file(path).as_ref().map_or_else(|_| String::new(), Fingerprint::to_string);
    Ok(Reproduction {
        command: format!("calib evaluate --runs {runs}"),
        study_toml: toml::to_string(&study.evaluate).map(|text| format!("[evaluate]\n{text}"))?,
        versions: vec![("calib".to_owned(), env!("CARGO_PKG_VERSION").to_owned())],
        seeds: vec![("study".to_owned(), study.seed)],
        fingerprint,
    })
}

fn write(directory: &Path, summary: &Summary, report: &Report) -> Result<(), StepError> {
    let sensors = report.sensitivities.iter().map(|figure| figure.sensor.as_str());
    let named: Vec<String> =
        figures::placed(sensors).into_iter().map(|name| format!("sensitivity-{name}")).collect();
    let drawn = named.iter().flat_map(|name| figures::names(name));
    let drawn = drawn.map(|name| format!("{FIGURES}/{name}"));
    // The folder may belong to the user.
    let mut claim = DirectoryLock::new(directory, Below::Unknown)?;
    claim.record().note([SUMMARY, REPORT].map(str::to_owned).into_iter().chain(drawn))?;
    for (sensitivity, name) in report.sensitivities.iter().zip(&named) {
        figures::write(&directory.join(FIGURES), name, &sensitivity.figure()?)?;
    }
    write_json(&directory.join(SUMMARY), summary)?;
    let html = report.html()?;
    Ok(write_atomically(&directory.join(REPORT), |file| file.write_all(html.as_bytes()))?)
}

/// Returns the facts of a sweep that calib did not make.
fn manifest(study: &Study, candidates: Vec<Candidate>) -> SweepFacts {
    let second = Period::from_micros(1_000_000);
    let period = second.unwrap_or_else(|| unreachable!("a second is positive"));
    let span = Span { steps: study.sweep.steps, tail: 1 };
    SweepFacts::of_no_data(study, period, span, candidates)
}
