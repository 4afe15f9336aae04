//! The report: results as typed rows for the page.

use std::{io::Write as _, path::Path};

use calib_data::table::read_parquet_columns;
use calib_files::{write_atomically, write_json};
use calib_report::{
    Agreement, Alternative, Cell, ErrorCurve, ErrorSource, JumpStatistics, RankCurve, Report,
    Reproduction, RolloutFigure, Score, Sensitivity, Setting, Table, TopK, Verdict,
};
use calib_represent::RepresentationKind;
use calib_stats::Summary as ScoreSummary;
use calib_sweep::{Candidate, EnvironmentScores, Role, SensorVerdict};

use super::{
    artefact::{self, Below, Claim},
    collapse, comparison,
    evaluate::{Judged, Summary},
    figures::{self, Starts},
    jumps as jump_text, learning,
    model_files::{self, ModelManifest},
    one_step, recurrence,
    report_data::{data_profile, subtitle},
    represent::{self, RepresentationManifest},
    rollout::{self, RolloutManifest},
    sweep::SweepManifest,
};
use crate::study::{Study, StudyPaths};

/// Write the summary, the figures and `report.html`.
pub(super) fn write(paths: &StudyPaths, report: &Report, summary: &Summary) -> anyhow::Result<()> {
    let _claim = Claim::new(&paths.evaluate(), Below::Ours)?;
    write_json(&paths.evaluate().join("summary.json"), summary)?;
    let directory = paths.evaluate().join("figures");
    write_comparisons(&directory, report)?;
    for sensitivity in &report.sensitivities {
        let name = format!("sensitivity-{}", sensitivity.sensor);
        figures::write(&directory, &name, &sensitivity.figure()?)?;
    }
    for curves in &report.learning {
        let environment = curves.environment.to_lowercase().replace(' ', "-");
        let name = format!("learning-{}-{environment}", curves.sensor);
        figures::write(&directory, &name, &curves.figure()?)?;
    }
    for rollout in &report.rollouts {
        figures::write(&directory, &format!("rollout-{}", rollout.sensor), &rollout.figure()?)?;
    }
    write_page(paths, report)
}

/// Write `report.html`.
pub(super) fn write_page(paths: &StudyPaths, report: &Report) -> anyhow::Result<()> {
    let html = report.html()?;
    if let Some(directory) = paths.report().parent().filter(|directory| directory.is_dir()) {
        artefact::remove_temporaries(directory, Below::Unknown)?;
    }
    Ok(write_atomically(&paths.report(), |file| file.write_all(html.as_bytes()))?)
}

/// Write the figures that show all sensors, or all models, beside each other.
pub(super) fn write_comparisons(directory: &Path, report: &Report) -> anyhow::Result<()> {
    if !report.sensitivities.is_empty() {
        figures::write(directory, "sensitivity", &Sensitivity::panels(&report.sensitivities)?)?;
    }
    for grid in &report.rollout_grids {
        figures::write(directory, &format!("rollouts-{}", placed(&grid.sensor)), &grid.figure()?)?;
    }
    Ok(())
}

/// A sensor in a deployment or of a model, as a part of file names: "PIT300 (april)" is `PIT300-april`.
pub(super) fn placed(sensor: &str) -> String {
    sensor.replace(" (", "-").replace(", ", "-").replace(')', "")
}

/// Everything that is known of a finished sweep and its model.
pub(super) fn assemble(judged: &Judged) -> anyhow::Result<Report> {
    let Judged { study, written, paths, manifest: sweep, summary, results } = judged;
    let candidates = &sweep.candidates;
    let model: ModelManifest = artefact::require(&paths.model(), &paths.command("build-model"))?;
    let profile = model_files::read_profile(&paths.model())?;
    let rollouts = rollout::finished(study, paths, &model.key);
    let (shown, starts) = match &rollouts {
        Some(rollouts) => rollout_figures(paths, rollouts)?,
        None => (Vec::new(), Vec::new()),
    };
    let grids = starts.iter().flat_map(|of| figures::grids(&[(study.model_name(), of)]));
    Ok(Report {
        title: summary.title.clone(),
        subtitle: Some(subtitle(&profile, &model, judged)),
        score: Score::nrmse(),
        decision: None,
        verdicts: summary
            .verdicts
            .iter()
            .map(|verdict| verdict_row(verdict, candidates, study))
            .collect(),
        warnings: summary.notes.clone(),
        sensitivities: summary
            .verdicts
            .iter()
            .map(|verdict| sensitivity(verdict, candidates, study.model_name()))
            .collect(),
        learning: learning::curves(&study.sweep.sensors, candidates, results)?,
        rollouts: shown,
        rollout_grids: grids.collect(),
        jumps: jumps(&model),
        tables: tables(study, paths, &model, rollouts.as_ref()),
        data: Some(data_profile(&profile, &model, judged)),
        reproduction: reproduction(written, paths, &commands(&[study]), sweep)?,
    })
}

/// What the rollouts were like, and the representations that could be used.
fn tables(
    study: &Study,
    paths: &StudyPaths,
    model: &ModelManifest,
    rollouts: Option<&RolloutManifest>,
) -> Vec<Table> {
    let name = study.model_name();
    let collapse = rollouts.and_then(|of| collapse::report_table(name, &of.collapse));
    let starts = rollouts.and_then(|of| starts_table(name, of));
    let compared = rollouts.and_then(|of| of.comparison.as_ref());
    let compared = compared.map(|of| comparison::report_tables(&[(name, of)]));
    let representations = representation_table(study, paths);
    let one_step = rollouts.and_then(|of| one_step::read(study, paths, &of.model));
    let one_step = one_step.and_then(|of| one_step::report_table(&[(name, &of)]));
    let rolled_out = one_step.into_iter().chain(compared.into_iter().flatten()).chain(starts);
    let walks = recurrence::report_table(model);
    collapse.into_iter().chain(rolled_out).chain(walks).chain(representations).collect()
}

/// How many start states each member lacks, and how far what stands for them is; none where all are there.
pub(super) fn starts_table(model: &str, rollouts: &RolloutManifest) -> Option<Table> {
    let all = rollouts.members.iter().map(|member| &member.starts);
    if all.clone().all(|starts| starts.mean_distance.is_none()) {
        return None;
    }
    let cell = |distance: Option<f64>| distance.map_or(Cell::Missing, Cell::Number);
    let rows = all.enumerate().map(|(member, starts)| {
        vec![
            Cell::Text(format!("member {member}")),
            Cell::Count(starts.starts as u64),
            Cell::Count(starts.replaced as u64),
            cell(starts.mean_distance),
            cell(starts.largest_distance),
        ]
    });
    let columns = ["member", "start states", "in the block left out", "mean distance", "largest"];
    Some(Table {
        title: "Start states".to_owned(),
        caption: format!(
            "{model}: a start state that lies in the block that a member leaves out, or in no block because it is of \
             the deployment, is replaced by the nearest that the member has. Distances are from what was asked for \
             to what stands for it, in the metric of the model."
        ),
        columns: columns.map(str::to_owned).to_vec(),
        rows: rows.collect(),
        best: None,
    })
}

/// The representations that could be used, if the study has any.
pub(super) fn representation_table(study: &Study, paths: &StudyPaths) -> Option<Table> {
    (study.representation.kind != RepresentationKind::None)
        .then(|| artefact::read::<RepresentationManifest>(&paths.representation()))
        .flatten()
        .map(|manifest| represent::report_table(&manifest))
}

/// The swept field, or all of them where there are several.
pub(super) fn field(candidates: &[Candidate]) -> String {
    let fields = candidates[0].values.iter().map(|(field, _)| field.as_str());
    fields.collect::<Vec<_>>().join(", ")
}

/// The value of a candidate: a number where one numeric field is swept, else its label.
pub(super) fn setting(candidate: &Candidate) -> Setting {
    match candidate.values.as_slice() {
        [(_, value)] => value
            .as_f64()
            .map_or_else(|| Setting::Name(calib_sweep::written(value)), Setting::Number),
        _ => Setting::Name(candidate.label()),
    }
}

/// The values of the grid along an axis. A step size of 0, the agent as it was pre-trained, has no place on a
/// logarithmic axis: values beside it are evenly spaced names.
fn axis(grid: &[&Candidate]) -> Vec<Setting> {
    let values: Vec<Setting> = grid.iter().map(|candidate| setting(candidate)).collect();
    let zero = values.iter().any(|value| value.as_number() == Some(0.0));
    let named = |value: Setting| if zero { Setting::Name(value.to_string()) } else { value };
    values.into_iter().map(named).collect()
}

/// The verdict on one sensor in words: what to deploy, then the reasons.
pub(super) fn advice(
    verdict: &SensorVerdict,
    candidates: &[Candidate],
    study: &Study,
) -> Vec<String> {
    let row = verdict_row(verdict, candidates, study);
    [row.headline()].into_iter().chain(row.reasons(&Score::nrmse())).collect()
}

fn verdict_row(verdict: &SensorVerdict, candidates: &[Candidate], study: &Study) -> Verdict {
    let of = |index: usize| setting(&candidates[index]);
    let selection = &verdict.selection;
    let online = verdict.model_agreement.as_ref().zip(verdict.best_online).map(|(model, best)| {
        let best_error =
            verdict.online.as_ref().map_or(f64::NAN, |online| online.candidates[best].mean);
        Agreement {
            chosen_error: model.online_error,
            best: of(best),
            best_error,
            regret: model.regret,
            spearman: model.spearman,
            kendall: model.kendall,
            top_k: Some(TopK { k: study.evaluate.top_k, hit: model.top_k_hit }),
        }
    });
    let alternative = |agreement: &calib_sweep::Agreement| Alternative {
        value: of(agreement.chosen),
        regret: agreement.regret,
    };
    Verdict {
        sensor: verdict.sensor.clone(),
        field: field(candidates),
        model: study.model_name().to_owned(),
        chosen: of(selection.chosen),
        tie_set: selection.tie_set.iter().map(|&tied| of(tied)).collect(),
        worst_rank: selection.worst_ranks[selection.chosen],
        values: selection.worst_ranks.len(),
        members: verdict.members.len(),
        online,
        default: verdict.default_agreement.as_ref().map(alternative),
        log_replay: verdict.log_replay_agreement.as_ref().map(alternative),
        notes: verdict.warnings.clone(),
    }
}

fn sensitivity(verdict: &SensorVerdict, candidates: &[Candidate], model: &str) -> Sensitivity {
    let grid: Vec<&Candidate> =
        candidates.iter().filter(|candidate| candidate.role == Role::Grid).collect();
    let curve = |scores: &EnvironmentScores, label: &str, source| ErrorCurve {
        label: label.to_owned(),
        source,
        summaries: scores.candidates[..grid.len()]
            .iter()
            .copied()
            .map(Some)
            .collect::<Vec<Option<ScoreSummary>>>(),
    };
    let mut errors = Vec::new();
    if let Some(online) = &verdict.online {
        errors.push(curve(online, "Online (held-out)", ErrorSource::Online));
    }
    if let Some(replay) = &verdict.log_replay {
        errors.push(curve(replay, "Log replay", ErrorSource::LogReplay));
    }
    Sensitivity {
        sensor: verdict.sensor.clone(),
        field: field(candidates),
        score: Score::nrmse(),
        values: axis(&grid),
        errors,
        worst_ranks: vec![RankCurve {
            label: format!("{model}, worst rank"),
            worst_ranks: verdict.selection.worst_ranks.clone(),
        }],
        chosen: Some(verdict.selection.chosen),
        default: grid.iter().position(|candidate| candidate.is_default),
    }
}

/// The rollouts over what was recorded, and all starts that they were made from.
pub(super) fn rollout_figures(
    paths: &StudyPaths,
    manifest: &RolloutManifest,
) -> anyhow::Result<(Vec<RolloutFigure>, Vec<Starts>)> {
    let mut columns =
        ["member", "rollout", "wanted_row", "wanted_timestamp"].map(str::to_owned).to_vec();
    for sensor in &manifest.sensors {
        columns.extend([sensor.clone(), format!("{sensor}.recorded")]);
    }
    let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
    let path = paths.rollout().join("trajectories.parquet");
    let trajectories = read_parquet_columns(&path, &columns)?;
    let (sensors, period_secs) = (&manifest.sensors, manifest.period_secs);
    let shown = figures::rollouts(&trajectories, sensors, period_secs)?;
    Ok((shown, figures::starts(&trajectories, sensors, period_secs)?))
}

fn jumps(model: &ModelManifest) -> Vec<JumpStatistics> {
    let members = model.members.iter().enumerate();
    members
        .filter_map(|(member, summary)| {
            let jumps = summary.jumps.as_ref()?;
            Some(JumpStatistics {
                model: model.study.model_name().to_owned(),
                member,
                steps: jumps.steps as u64,
                jump_rate: jumps.jump_rate,
                mean_run_length: jumps.mean_run_length,
                note: jump_text::note(jumps, summary.transitions).map(str::to_owned),
            })
        })
        .collect()
}

/// The commands that make the report of studies that differ in their models only.
pub(super) fn commands(models: &[&Study]) -> Vec<&'static str> {
    let represented = |study: &&Study| {
        !study.is_parametric() && study.representation.kind != RepresentationKind::None
    };
    let pretrained =
        |study: &&Study| study.pretrain.epochs > 0 && study.pretrain.checkpoint.is_none();
    let needed = [
        ("pretrain", models.iter().any(pretrained)),
        ("represent", models.iter().any(represented)),
    ];
    let needed = needed.into_iter().filter(|(_, needed)| *needed).map(|(command, _)| command);
    needed.chain(["build-model", "rollout", "sweep", "evaluate"]).collect()
}

fn reproduction(
    written: &Study,
    paths: &StudyPaths,
    commands: &[&str],
    sweep: &SweepManifest,
) -> anyhow::Result<Reproduction> {
    let laid_over = paths.profile().map_or_else(String::new, |name| {
        format!("# with [profiles.{name}] laid over the rest: as a file of its own it is run without --profile\n")
    });
    Ok(Reproduction {
        command: command_lines(paths, commands),
        study_toml: laid_over + &toml::to_string(written)?,
        versions: vec![("calib".to_owned(), env!("CARGO_PKG_VERSION").to_owned())],
        seeds: vec![("study".to_owned(), written.seed)],
        fingerprint: sweep.data.to_string(),
    })
}

/// What to type, one command a line.
pub(super) fn command_lines(paths: &StudyPaths, commands: &[&str]) -> String {
    commands.iter().map(|command| paths.command(command)).collect::<Vec<_>>().join("\n")
}
