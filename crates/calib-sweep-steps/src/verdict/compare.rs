//! One report on several models and deployments of the same study.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use calib_base::{
    StepError,
    artefact::{self, TOOL},
    ensure,
    log::context::RunContext,
    outcome::{NoPlan, Outcome, StepResult},
};
use calib_files::write_json;
use calib_model_steps::rollouts::figures::{self, FirstRollouts};
use calib_report::{ErrorCurve, ErrorSource, Report, RolloutGrid, Sensitivity, Verdict, caveats};
use calib_study::{Job, Layout, Study};
use calib_sweep::SensorVerdict;
use schemars::JsonSchema;
use serde::Serialize;

use crate::verdict::{
    compare_choices::choices,
    compare_pairs::{self, Comparisons},
    compare_tables,
    deployed::{self, Deployed},
    evaluate::{self, outcome_of},
    judged::Summary,
    judged_model::{JudgedModel, by_deployment},
    learning_together, recorded_together, report, report_cache, report_data,
};

/// The verdicts on several models and deployments, side by side.
#[derive(Debug)]
pub struct Compared {
    pub(crate) summaries: Summaries,
    /// The models and deployments, in the order of judgement.
    pub(crate) places: Vec<SummaryPlace>,
    /// The choices of the models, as a table for a terminal.
    pub(crate) choices: String,
    pub(crate) notes: Vec<String>,
    pub(crate) report: PathBuf,
    pub(crate) outcome: Outcome,
}

/// The place of a summary: its model and deployment, and their joint name.
#[derive(Debug)]
pub(crate) struct SummaryPlace {
    pub(crate) name: String,
    model: String,
    deployment: Option<String>,
}

impl Compared {
    /// Returns the verdicts on each sensor for one model in one deployment. The model or the deployment is one
    /// of several.
    pub fn verdicts(&self, model: &str, deployment: Option<&str>) -> &[SensorVerdict] {
        self.summary(model, deployment).map_or(&[], |summary| &summary.verdicts)
    }

    /// Returns the verdicts as `summary.json` stores them, which `--json` prints.
    pub fn summaries(&self) -> &Summaries {
        &self.summaries
    }

    /// Returns the path of the common report.
    pub fn report(&self) -> &Path {
        &self.report
    }

    /// Returns the summary of a place.
    pub(crate) fn at(&self, place: &SummaryPlace) -> Option<&Summary> {
        self.summary(&place.model, place.deployment.as_deref())
    }

    fn summary(&self, model: &str, deployment: Option<&str>) -> Option<&Summary> {
        let Summaries { models, deployments, .. } = &self.summaries;
        match deployment {
            None => models.get(model),
            Some(name) => deployments.iter().find(|own| own.deployment == name)?.models.get(model),
        }
    }
}

/// `summary.json` of several models and deployments.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Summaries {
    format: u32,
    tool: &'static str,
    title: String,
    /// Results by model, for a study without deployments.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    models: BTreeMap<String, Summary>,
    /// One entry for each deployment, in order of time.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    deployments: Vec<DeploymentSummary>,
    /// The recommendation for each sensor, if there are several deployments.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) what_to_deploy: Vec<Deployed>,
    /// Comparisons of every two models.
    pub(crate) comparisons: Comparisons,
}

/// Results for one deployment of a study.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct DeploymentSummary {
    deployment: String,
    /// Its held-out period, as in the study.
    window: String,
    /// Results by name of the model. A study's only model has the name of its kind.
    models: BTreeMap<String, Summary>,
}

/// Judges the finished sweeps of `parts`, each by itself and all in one report. The report warns about models
/// that were `left_out`.
pub(crate) fn run(
    job: &Job,
    parts: &[Job],
    left_out: &[String],
    context: &RunContext,
) -> Result<StepResult<Compared>, StepError> {
    // The folder of the common results is that of the study without a model.
    let paths = job.layout();
    if job.policy().is_dry() {
        context.say(&format!("dry run: would write {}", paths.report().display()));
        return Ok(StepResult::Planned(NoPlan));
    }
    let mut left_out = left_out.to_vec();
    let mut judged = Vec::with_capacity(parts.len());
    for part in parts {
        match evaluate::left_out(part, context)? {
            Some(reason) if !left_out.contains(&reason) => left_out.push(reason),
            Some(_) => {}
            None => judged.push(part.clone()),
        }
    }
    let mut outcome = if left_out.is_empty() { Outcome::Done } else { Outcome::Negative };
    let parts = judged;
    ensure!(!parts.is_empty(), "nothing is left to judge: {}", left_out.join("; "));
    let names: Vec<String> = parts.iter().map(Job::name).collect();
    let monitor = context.progress();
    let mut judged = Vec::with_capacity(parts.len());
    for job in &parts {
        judged.push(JudgedModel::new(job, context, &*monitor)?);
    }
    let parts = judged;
    same_arithmetic(&names, &parts)?;
    let mut places = Vec::with_capacity(parts.len());
    for (name, part) in names.into_iter().zip(&parts) {
        let JudgedModel { judged, report, .. } = part;
        let written = report::write(&judged.job, report, &judged.summary, &*monitor);
        artefact::or_read_only(written, &judged.paths().report(), context)?;
        match outcome_of(&judged.summary) {
            Outcome::Done => {}
            other => outcome = other,
        }
        let model = part.model_name().to_owned();
        let deployment = part.deployment.clone();
        places.push(SummaryPlace { name, model, deployment });
    }
    let what_to_deploy = deployed::all(&parts)?;
    let mut whole = whole(job, &parts, &what_to_deploy)?;
    whole.warnings.extend_from_slice(&left_out);
    let choices = choices(&parts);
    let comparisons = compare_pairs::comparisons(&by_deployment(&parts))?;
    let title = whole.title.clone();
    let summaries = summaries(title, parts, what_to_deploy, comparisons);
    artefact::or_read_only(write(job, &whole, &summaries), &paths.report(), context)?;
    let notes = [caveats(&whole.verdicts), whole.warnings].concat();
    let report = paths.report();
    Ok(StepResult::Made(Compared { summaries, places, choices, notes, report, outcome }))
}

/// Refuses sweeps if only some were made on a device, because devices round differently.
fn same_arithmetic(names: &[String], parts: &[JudgedModel]) -> Result<(), StepError> {
    let first = trained_by(&parts[0]);
    for (name, part) in names.iter().zip(parts) {
        ensure!(
            trained_by(part) == first,
            "{} was swept by {first}, {name} by {}; sweep all of them with the same --device, or all without",
            names[0],
            trained_by(part)
        );
    }
    Ok(())
}

/// Returns the class of the device that a sweep was made on, for messages.
fn trained_by(part: &JudgedModel) -> String {
    let class = part.judged.manifest.arithmetic.clone();
    class.unwrap_or_else(|| "calib itself".to_owned())
}

/// Writes the figures, the page and the summary, unless the existing ones show the same.
fn write(job: &Job, whole: &Report, summaries: &Summaries) -> Result<(), StepError> {
    let paths = job.layout();
    report_cache::keep(job, whole, summaries, || {
        let figures = write_figures(paths, whole)?;
        report::write_page(paths, whole)?;
        write_json(&paths.evaluate().join(report::SUMMARY), summaries)?;
        Ok(report::names(figures))
    })
}

/// Writes sensitivity figures with all models, one per sensor and deployment and one with all, and rollouts of
/// all models. Returns the file names.
fn write_figures(paths: &Layout, whole: &Report) -> Result<Vec<String>, StepError> {
    let directory = paths.evaluate().join(report::FIGURES);
    let mut written = Vec::new();
    let names = figures::placed(whole.sensitivities.iter().map(|figure| figure.sensor.as_str()));
    for (sensitivity, name) in whole.sensitivities.iter().zip(names) {
        let name = format!("sensitivity-{name}");
        written.extend(figures::write(&directory, &name, &sensitivity.figure()?)?);
    }
    written.extend(report::write_comparisons(&directory, whole)?);
    Ok(written)
}

fn summaries(
    title: String,
    parts: Vec<JudgedModel>,
    what_to_deploy: Vec<Deployed>,
    comparisons: Comparisons,
) -> Summaries {
    let mut models = BTreeMap::new();
    let mut deployments = Vec::<DeploymentSummary>::new();
    for part in parts {
        let name = part.model_name().to_owned();
        let Some(deployment) = part.deployment else {
            models.insert(name, part.judged.summary);
            continue;
        };
        let window = part.judged.study().data.held_out.as_ref().map(ToString::to_string);
        let place = deployments.iter().position(|known| known.deployment == deployment);
        let place = place.unwrap_or_else(|| {
            let window = window.unwrap_or_default();
            let models = BTreeMap::new();
            deployments.push(DeploymentSummary { deployment, window, models });
            deployments.len() - 1
        });
        deployments[place].models.insert(name, part.judged.summary);
    }
    Summaries { format: 4, tool: TOOL, title, models, deployments, what_to_deploy, comparisons }
}

/// Assembles the report: verdicts by sensor, all rank curves over the same Online errors, distances side by
/// side.
fn whole(
    job: &Job,
    parts: &[JudgedModel],
    what_to_deploy: &[Deployed],
) -> Result<Report, StepError> {
    let study = job.study();
    let deployments = by_deployment(parts);
    let first = &parts[0].report;
    let mut verdicts = Vec::new();
    for sensor in &study.sweep.sensors {
        for part in deployments.iter().flatten() {
            for verdict in part.report.verdicts.iter().filter(|own| own.sensor == *sensor) {
                verdicts.push(Verdict { sensor: part.in_deployment(sensor), ..verdict.clone() });
            }
        }
    }
    let sensitivities = study
        .sweep
        .sensors
        .iter()
        .flat_map(|sensor| deployments.iter().filter_map(|group| sensitivity(sensor, group)));
    let mut whole = Report {
        title: job.title(),
        verdicts,
        sensitivities: sensitivities.collect(),
        learning: learning_together::of_several(study, parts, &deployments),
        decision: deployed::report_table(what_to_deploy),
        recorded: recorded_together::of_parts(&study.sweep.sensors, &deployments),
        rollouts: Vec::new(),
        rollout_grids: rollout_grids(study, &deployments),
        jumps: Vec::new(),
        warnings: compare_tables::warnings(parts),
        ..first.clone()
    };
    let mut seen: Vec<PathBuf> = Vec::new();
    for part in parts {
        let directory = part.judged.paths().rollout();
        if !seen.contains(&directory) {
            seen.push(directory);
            whole.rollouts.extend(part.report.rollouts.iter().map(|figure| {
                let mut figure = figure.clone();
                if part.judged.study().starts_follow_from_deployment() {
                    figure.sensor = part.in_deployment(&figure.sensor);
                }
                if let Some(name) = &part.model {
                    figure.sensor = format!("{}, {name}", figure.sensor);
                }
                figure
            }));
        }
    }
    // If parts learned from or were judged on different periods, they have no common subtitle.
    if parts.iter().any(|part| part.report.subtitle != whole.subtitle) {
        whole.subtitle = None;
    }
    // The jumps of a model are the same in all deployments.
    for part in &deployments[0] {
        whole.jumps.extend(part.report.jumps.clone());
    }
    whole.tables = compare_tables::tables(&deployments)?;
    (whole.data, whole.reproduction.fingerprint) = compare_tables::data_of_models(&deployments[0]);
    if let Some(data) = &mut whole.data {
        data.facts.retain(|(name, _)| !report_data::is_of_deployment(name));
        for group in &deployments {
            for (name, value) in report_data::deployment_facts(&group[0].judged) {
                let name = match &group[0].deployment {
                    Some(deployment) => format!("{deployment}: {name}"),
                    None => name,
                };
                data.facts.push((name, value));
            }
        }
    }
    let studies: Vec<&Study> = parts.iter().map(|part| part.judged.study()).collect();
    whole.reproduction.command =
        report::command_lines(job, &report::steps(&studies), &parts[0].judged.manifest);
    Ok(whole)
}

/// Returns every model's rollouts from the same starts: one figure per sensor, and per deployment if the starts
/// depend on it.
fn rollout_grids(study: &Study, deployments: &[Vec<&JudgedModel>]) -> Vec<RolloutGrid> {
    let mut grids = Vec::new();
    for sensor in &study.sweep.sensors {
        for (number, group) in deployments.iter().enumerate() {
            // Rollouts that deployments share appear only once, with the first, and without its name.
            for follows in [true, false] {
                let own = group.iter().filter(|part| {
                    part.judged.study().starts_follow_from_deployment() == follows
                        && (follows || number == 0)
                });
                let own = own.filter_map(|part| {
                    let starts = part.starts.iter().find(|starts| starts.sensor == *sensor)?;
                    Some((part.model_name(), starts))
                });
                let own: Vec<(&str, &FirstRollouts)> = own.collect();
                grids.extend(figures::grids(&own).into_iter().map(|mut grid| {
                    if let (true, Some(deployment)) = (follows, &group[0].deployment) {
                        grid.sensor = format!("{} ({deployment})", grid.sensor);
                    }
                    grid
                }));
            }
        }
    }
    grids
}

/// Returns the panel of one sensor in one deployment: the Online errors, and the worst ranks of all models.
fn sensitivity(sensor: &str, group: &[&JudgedModel]) -> Option<Sensitivity> {
    let all: Vec<Sensitivity> = group
        .iter()
        .filter_map(|part| {
            part.report.sensitivities.iter().find(|figure| figure.sensor == sensor).cloned()
        })
        .collect();
    let mut whole = all.first()?.clone();
    whole.sensor = group[0].in_deployment(sensor);
    whole.worst_ranks = all.iter().flat_map(|figure| figure.worst_ranks.clone()).collect();
    // All models share Online and the log. The evidence that each model chose by differs.
    whole.errors.retain(|curve| !is_evidence(curve));
    let evidence = all.iter().flat_map(|figure| &figure.errors).filter(|curve| is_evidence(curve));
    whole.errors.extend(evidence.cloned());
    // If choices differ, none is marked.
    whole.chosen = whole.chosen.filter(|_| all.iter().all(|figure| figure.chosen == whole.chosen));
    Some(whole)
}

fn is_evidence(curve: &ErrorCurve) -> bool {
    curve.source == ErrorSource::Evidence
}
