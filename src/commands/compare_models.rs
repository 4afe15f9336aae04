//! One report on several models of the same study.

use std::{collections::BTreeMap, io::Write as _};

use calib_files::{write_atomically, write_json};
use calib_report::{LearningCurves, Report, Verdict};
use serde::Serialize;

use super::{
    artefact::{self, Below, Claim, TOOL},
    collapse,
    comparison::{self, Comparison},
    evaluate::{Judged, Summary, judge, print, told},
    learning, load_study, report,
    rollout::RolloutManifest,
};
use crate::{
    cli::StudyArgs,
    exit::ExitStatus,
    output::{Printer, percent, significant, table},
    study::{Study, StudyPaths},
};

/// `summary.json` of several models.
#[derive(Serialize)]
struct Summaries {
    format: u32,
    tool: &'static str,
    title: String,
    models: BTreeMap<String, Summary>,
}

/// A model with all that is known of it.
struct Model {
    name: String,
    judged: Judged,
    report: Report,
    rollouts: Option<RolloutManifest>,
}

impl Model {
    fn comparison(&self) -> Option<&Comparison> {
        self.rollouts.as_ref()?.comparison.as_ref()
    }
}

/// Judge the finished sweeps of the models called `names`, each by itself and all in one report, which warns of those
/// that were `left_out`.
pub(super) fn run(
    args: &StudyArgs,
    names: &[String],
    left_out: &[String],
    printer: &Printer,
) -> anyhow::Result<ExitStatus> {
    // The study without any model says where the common results lie.
    let (study, paths) = load_study(args)?;
    if args.dry_run {
        printer.say(&format!("dry run: would write {}", paths.report().display()));
        return Ok(ExitStatus::Done);
    }
    let models = names
        .iter()
        .map(|name| model(&StudyArgs { model: Some(name.clone()), ..args.clone() }, name))
        .collect::<anyhow::Result<Vec<Model>>>()?;
    let mut ended = ExitStatus::Done;
    for Model { name, judged, report, .. } in &models {
        report::write(&judged.paths, report, &judged.summary)?;
        if !args.json {
            printer.heading(&format!("model {name}"));
            print(&judged.summary, &judged.paths, printer)?;
        }
        match told(&judged.summary) {
            ExitStatus::Done => {}
            other => ended = other,
        }
    }
    let mut whole = whole(&study, &paths, args, &models);
    whole.warnings.extend_from_slice(left_out);
    let comparison = show(&models);
    let _claim = Claim::new(&paths.evaluate(), Below::Ours)?;
    let title = whole.title.clone();
    let html = whole.html()?;
    write_atomically(&paths.report(), |file| file.write_all(html.as_bytes()))?;
    let models = models.into_iter().map(|model| (model.name, model.judged.summary));
    let summaries = Summaries { format: 1, tool: TOOL, title, models: models.collect() };
    write_json(&paths.evaluate().join("summary.json"), &summaries)?;
    if args.json {
        printer.json(&summaries)?;
    } else {
        printer.result(&comparison)?;
        printer.result(&format!("report: {}", paths.report().display()))?;
    }
    Ok(ended)
}

fn model(args: &StudyArgs, name: &str) -> anyhow::Result<Model> {
    let judged = judge(args)?;
    let Judged { study, paths, manifest, .. } = &judged;
    let mut report = report::assemble(&judged)?;
    // In one report with others a model is called what the study calls it.
    let renamed = |text: &mut String| *text = text.replace(study.model_name(), name);
    report.verdicts.iter_mut().for_each(|verdict| renamed(&mut verdict.model));
    report.jumps.iter_mut().for_each(|jumps| renamed(&mut jumps.model));
    let ranks = report.sensitivities.iter_mut().flat_map(|of| &mut of.worst_ranks);
    ranks.for_each(|curve| renamed(&mut curve.label));
    for curves in report.learning.iter_mut().filter(|of| !learning::is_shared(of)) {
        curves.environment = format!("{} of {name}", curves.environment);
    }
    for rollout in &mut report.rollouts {
        rollout.sensor = format!("{}, {name}", rollout.sensor);
    }
    let rollouts = artefact::read::<RolloutManifest>(&paths.rollout())
        .filter(|rollouts| rollouts.model == manifest.model);
    Ok(Model { name: name.to_owned(), judged, report, rollouts })
}

/// Verdicts sensor by sensor, all rank curves over the same Online errors, distances side by side.
fn whole(study: &Study, paths: &StudyPaths, args: &StudyArgs, models: &[Model]) -> Report {
    let mut whole = models[0].report.clone();
    whole.title = super::evaluate::title(study, args);
    let sensors = study.sweep.sensors.iter();
    let of_sensor = |sensor: &String| -> Vec<Verdict> {
        let all = models.iter().flat_map(|model| &model.report.verdicts);
        all.filter(|verdict| verdict.sensor == *sensor).cloned().collect()
    };
    whole.verdicts = sensors.clone().flat_map(of_sensor).collect();
    // What is run once for all models is the first one's; every other curve is that of a model.
    let of_sensor = |sensor: &String| -> Vec<LearningCurves> {
        let all = models.iter().enumerate().flat_map(|(number, model)| {
            model.report.learning.iter().filter(move |of| number == 0 || !learning::is_shared(of))
        });
        all.filter(|of| of.sensor == *sensor).cloned().collect()
    };
    whole.learning = sensors.flat_map(of_sensor).collect();
    whole.rollouts = models.iter().flat_map(|model| model.report.rollouts.clone()).collect();
    for Model { report, .. } in &models[1..] {
        for sensitivity in &mut whole.sensitivities {
            let same = report.sensitivities.iter().find(|of| of.sensor == sensitivity.sensor);
            sensitivity.worst_ranks.extend(same.iter().flat_map(|of| of.worst_ranks.clone()));
        }
        whole.jumps.extend(report.jumps.clone());
        for warning in &report.warnings {
            if !whole.warnings.contains(warning) {
                whole.warnings.push(warning.clone());
            }
        }
    }
    let compared: Vec<(&str, &Comparison)> = models
        .iter()
        .filter_map(|model| Some((model.name.as_str(), model.comparison()?)))
        .collect();
    whole.tables = comparison::report_tables(&compared);
    let collapse = models.iter().filter_map(|model| {
        collapse::report_table(&model.name, &model.rollouts.as_ref()?.collapse)
    });
    whole.tables.extend(collapse);
    for Model { name, judged, .. } in models {
        let own = report::representation_table(&judged.study, &judged.paths);
        whole.tables.extend(own.into_iter().map(|mut table| {
            table.title = format!("{} of {name}", table.title);
            table
        }));
    }
    let studies: Vec<&Study> = models.iter().map(|model| &model.judged.study).collect();
    whole.reproduction.command = report::command_lines(paths, &report::commands(&studies));
    whole
}

/// What each model chose, how that did Online, and how far its rollouts are from what was recorded.
fn show(models: &[Model]) -> String {
    let mut rows = Vec::new();
    for first in &models[0].report.verdicts {
        for model in models {
            let own = model.report.verdicts.iter().find(|of| of.sensor == first.sensor);
            let Some(verdict) = own else { continue };
            let online = verdict.online.as_ref();
            let or_none = |text: Option<String>| text.unwrap_or_else(|| "–".to_owned());
            let distances = model.comparison().map_or(&[][..], |of| &of.sensors);
            let own = distances.iter().find(|of| of.sensor == first.sensor);
            let warping = own.and_then(|of| {
                let pattern = of.dtw.first()?;
                Some(pattern.normalized_distance.as_ref().unwrap_or(&pattern.distance).mean)
            });
            rows.push(vec![
                first.sensor.clone(),
                model.name.clone(),
                verdict.chosen.to_string(),
                or_none(online.and_then(|online| Some(percent(online.regret?)))),
                or_none(online.and_then(|online| Some(format!("{:.2}", online.spearman?)))),
                or_none(warping.map(significant)),
                or_none(collapse(model, &first.sensor)),
            ]);
        }
    }
    let header = ["sensor", "model", "choice", "regret", "Spearman", "DTW", "collapse"];
    table(&header, &rows)
}

/// How many rollouts stop moving, and half of them by which step.
fn collapse(model: &Model, sensor: &str) -> Option<String> {
    let collapse = &model.rollouts.as_ref()?.collapse;
    let own = collapse.sensors.iter().find(|of| of.sensor == sensor)?;
    let at = own.median_step.map_or_else(String::new, |step| format!(" at {step:.0}"));
    Some(format!("{} of {}{at}", own.collapsed, collapse.rollouts))
}
