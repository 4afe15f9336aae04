use anyhow::{Context as _, bail};
use calib_agent::Part;
use calib_core::Seed;
use calib_rollout::StartKind;
use calib_sweep::{Judging, SensorVerdict, SweepError, UnitResult, told_apart, verdict};
use serde::Serialize;

use super::{
    artefact::{self, MANIFEST, TOOL},
    load_study,
    model_files::{self, ModelManifest},
    report, rollout,
    sweep::{SweepManifest, unit_store},
};
use crate::{
    cli::StudyArgs,
    exit::ExitStatus,
    output::Printer,
    study::{Study, StudyPaths},
};

/// `summary.json`: the verdict for machines.
#[derive(Debug, Serialize)]
pub(super) struct Summary {
    pub(super) format: u32,
    pub(super) tool: &'static str,
    pub(super) title: String,
    /// The advice in words, one list of lines a sensor.
    pub(super) advice: Vec<Vec<String>>,
    /// Labels of the candidates that the verdicts count.
    pub(super) candidates: Vec<String>,
    pub(super) verdicts: Vec<SensorVerdict>,
    pub(super) notes: Vec<String>,
}

/// A finished sweep, and what follows from it.
pub(super) struct Judged {
    pub(super) study: Study,
    /// The study as it was written: with all its models, where `study` is that of one.
    pub(super) written: Study,
    pub(super) paths: StudyPaths,
    pub(super) manifest: SweepManifest,
    pub(super) results: Vec<UnitResult>,
    pub(super) summary: Summary,
}

/// Judge a finished sweep and write the report.
pub(super) fn run(args: &StudyArgs, printer: &Printer) -> anyhow::Result<ExitStatus> {
    let judged = judge(args)?;
    let Judged { paths, summary, .. } = &judged;
    if args.dry_run {
        printer.say(&format!("dry run: would write {}", paths.report().display()));
        return Ok(ExitStatus::Done);
    }
    let report = report::assemble(&judged)?;
    let written = report::write(paths, &report, summary);
    artefact::or_read_only(written, &paths.report(), printer)?;
    if args.json {
        printer.json(summary)?;
    } else {
        print(summary, paths, printer)?;
    }
    Ok(told(summary))
}

/// Whether every sensor's members prefer some value to another.
pub(super) fn told(summary: &Summary) -> ExitStatus {
    if summary.verdicts.iter().all(|verdict| told_apart(&verdict.selection)) {
        ExitStatus::Done
    } else {
        ExitStatus::Negative
    }
}

/// Why a deployment is not judged, if it is not.
pub(super) fn left_out(args: &StudyArgs) -> anyhow::Result<Option<String>> {
    let (study, paths) = load_study(args)?;
    let name = paths.deployment().unwrap_or_default();
    let reason = finished_sweep(&study, &paths)?.left_out;
    Ok(reason.map(|reason| format!("deployment {name} is left out: {reason}")))
}

/// Judge a finished sweep; nothing is written.
pub(super) fn judge(args: &StudyArgs) -> anyhow::Result<Judged> {
    let (study, paths) = load_study(args)?;
    let manifest = finished_sweep(&study, &paths)?;
    if let Some(reason) = &manifest.left_out {
        bail!("there is nothing to judge: {reason}");
    }
    let results = unit_store(&paths.sweep()).collect(&manifest.units).with_context(|| {
        format!("the sweep is not complete; run `{}` again", paths.command("sweep"))
    })?;
    let sensors = study.sweep.sensors.iter();
    let profile = model_files::read_profile(&paths.model())?;
    let doubts = profile.value_doubts();
    let verdicts = sensors
        .map(|sensor| {
            let mut verdict = verdict_of(sensor, study.part(), (&study, &manifest, &results))?;
            let of_it = doubts.iter().filter(|(name, _)| name == sensor);
            verdict.warnings.extend(of_it.map(|(_, doubt)| doubt.clone()));
            Ok(verdict)
        })
        .collect::<anyhow::Result<Vec<_>>>()?;
    let advice =
        verdicts.iter().map(|verdict| report::advice(verdict, &manifest, &study)).collect();
    let summary = Summary {
        format: 2,
        tool: TOOL,
        title: title(&study, args),
        advice,
        candidates: manifest.candidates.iter().map(calib_sweep::Candidate::label).collect(),
        verdicts,
        notes: [manifest.notes.clone(), stale_rollouts(&study, &paths, &manifest.model)?].concat(),
    };
    let whole = StudyArgs { model: None, deployment: None, ..args.clone() };
    let (written, _) = load_study(&whole)?;
    Ok(Judged { study, written, paths, manifest, results, summary })
}

/// What a finished sweep says about a sensor by the errors over `part` of each run.
pub(super) fn verdict_of(
    sensor: &str,
    part: Part,
    (study, manifest, results): (&Study, &SweepManifest, &[UnitResult]),
) -> Result<SensorVerdict, SweepError> {
    let judging = Judging {
        part,
        rule: study.evaluate.rule,
        top_k: study.evaluate.top_k,
        scales: &manifest.scales,
        resamples: study.evaluate.resamples,
        seed: Seed::new(study.seed).child("verdict"),
    };
    let mut verdict = verdict(sensor, &manifest.candidates, results, &judging)?;
    if study.sweep_starts().start == StartKind::Nearest {
        verdict.warnings.insert(0, LOOKED_AHEAD.to_owned());
    }
    Ok(verdict)
}

/// What a choice is that was made from rollouts that start at the nearest states to those of the deployment.
const LOOKED_AHEAD: &str = "the sweep's rollouts start at the recorded states that are nearest to those of the deployment: this \
     choice has looked into what it is judged on, as no choice can that is made before; sweep.start = \"recent\" is what is \
     known beforehand";

/// Whether a sweep was finished with the study as it is now.
pub(super) fn is_swept(args: &StudyArgs) -> anyhow::Result<bool> {
    let (study, paths) = load_study(args)?;
    Ok(finished_sweep(&study, &paths).is_ok())
}

/// Rollouts that another study made are left out of the report, which is no reason to refuse the verdict.
fn stale_rollouts(study: &Study, paths: &StudyPaths, model: &str) -> anyhow::Result<Vec<String>> {
    let there = paths.rollout().join(MANIFEST).exists();
    if there && rollout::finished(study, paths, model)?.is_none() {
        Ok(vec![format!(
            "the rollouts in {} were made with other settings, or are damaged, and are not shown; run `{}` again",
            paths.rollout().display(),
            paths.command("rollout")
        )])
    } else {
        Ok(Vec::new())
    }
}

/// The manifest of a sweep that was made with this study and the model as it is now.
fn finished_sweep(study: &Study, paths: &StudyPaths) -> anyhow::Result<SweepManifest> {
    let manifest: SweepManifest = artefact::require(&paths.sweep(), &paths.command("sweep"))?;
    let made = &manifest.study;
    let changed = [
        ("[sweep]", made.sweep == study.sweep),
        ("[agent]", made.agent == study.agent),
        ("[pretrain]", made.pretrain == study.pretrain),
        ("[rollout]", made.sweep_starts() == study.sweep_starts()),
        ("[representation]", study.is_parametric() || made.representation == study.representation),
        ("[model]", made.model == study.model),
        ("[dynamics]", !study.is_parametric() || made.dynamics == study.dynamics),
        ("[data]", made.data == study.data),
        ("[preprocess]", made.preprocess == study.preprocess),
        ("seed", made.seed == study.seed),
    ];
    if let Some((section, _)) = changed.iter().find(|(_, same)| !same) {
        bail!(
            "the sweep in {} was made with another {section}; run `{}` again",
            paths.sweep().display(),
            paths.command("sweep")
        );
    }
    let model = artefact::read::<ModelManifest>(&paths.model());
    if model.map(|model| model.content()).transpose()?.is_some_and(|of| of != manifest.model) {
        bail!("the model was built again after the sweep; run `{}` again", paths.command("sweep"));
    }
    artefact::check_files(&paths.sweep(), &manifest.files, &paths.command("sweep"))?;
    Ok(manifest)
}

pub(super) fn title(study: &Study, args: &StudyArgs) -> String {
    let stem = args.study.file_stem().map(|stem| stem.to_string_lossy().into_owned());
    study.evaluate.title.clone().or(stem).unwrap_or_default()
}

pub(super) fn print(
    summary: &Summary,
    paths: &StudyPaths,
    printer: &Printer,
) -> anyhow::Result<()> {
    for lines in &summary.advice {
        for (position, line) in lines.iter().enumerate() {
            printer.result(&if position == 0 { line.clone() } else { format!("    {line}") })?;
        }
    }
    for note in &summary.notes {
        printer.result(&format!("note: {note}"))?;
    }
    printer.result(&format!("report: {}", paths.report().display()))
}
