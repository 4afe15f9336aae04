//! Verdicts on a finished sweep of one model in one deployment.

use std::path::{Path, PathBuf};

use calib_agent::Part;
use calib_base::{
    Context as _, StepError,
    artefact::{self, MANIFEST},
    bail,
    log::{context::RunContext, partition},
    outcome::{NoPlan, Outcome, StepResult},
    output::span,
    stale::StoredArtefact,
};
use calib_core::{Monitor, Seed, numbers_apart};
use calib_data::ShownClock;
use calib_model::StartKind;
use calib_model_steps::{
    model::model_files,
    rollouts::{one_step, rollout},
};
use calib_report::RecordedFigure;
use calib_study::{Job, StepKind, Study};
use calib_sweep::{Judging, SensorVerdict, SweepError, UnitResult, verdict};

use crate::{
    sweep::{SweepFacts, SweepManifest, recorded, simple::SimpleErrors, unit_store},
    verdict::{
        judged::{Judged, Summary},
        learned, report,
        verdict_rows::{self, verdict_row},
    },
};

/// The verdicts on one model in one deployment.
#[derive(Debug)]
pub struct Judgement {
    pub(crate) summary: Summary,
    /// The report, if one was requested.
    pub(crate) report: Option<PathBuf>,
}

impl Judgement {
    /// Returns the verdict on each sensor.
    pub fn verdicts(&self) -> &[SensorVerdict] {
        &self.summary.verdicts
    }

    /// Returns the verdicts as `summary.json` stores them, which `--json` prints.
    pub fn summary(&self) -> &Summary {
        &self.summary
    }

    /// Returns the path of the report, if one was requested.
    pub fn report(&self) -> Option<&Path> {
        self.report.as_deref()
    }
}

/// Judges a finished sweep and writes the report. A dry run writes nothing.
///
/// # Errors
/// Fails as [`judge`] does, and if the report cannot be written.
pub fn run(job: &Job, context: &RunContext) -> Result<StepResult<Judgement>, StepError> {
    let monitor = context.progress();
    let judged = judge(job, context, &*monitor)?;
    let page = job.layout().report();
    if job.policy().is_dry() {
        context.say(&format!("dry run: would write {}", page.display()));
        return Ok(StepResult::Planned(NoPlan));
    }
    let report = report::assemble(&judged)?;
    let written = report::write(job, &report, &judged.summary, &*monitor);
    artefact::or_read_only(written, &page, context)?;
    Ok(StepResult::Made(Judgement { summary: judged.summary, report: Some(page) }))
}

/// Returns the outcome: done if the evidence prefers some setting for every sensor.
pub(crate) fn outcome_of(summary: &Summary) -> Outcome {
    if summary.verdicts.iter().all(SensorVerdict::tells_apart) {
        Outcome::Done
    } else {
        Outcome::Negative
    }
}

/// Returns the reason why a deployment is not judged, if there is one.
///
/// # Errors
/// Returns an error if the sweep is not finished, or not of this study.
pub fn left_out(job: &Job, context: &RunContext) -> Result<Option<String>, StepError> {
    let name = job.deployment().unwrap_or_default();
    let reason = finished_sweep(job, context)?.facts.left_out;
    Ok(reason.map(|reason| format!("deployment {name} is left out: {reason}")))
}

/// Judges a finished sweep. Nothing is written.
///
/// # Errors
/// Returns an error if the sweep is not finished, not of this study or damaged, if nothing in it can be judged, or if
/// the `monitor` asks to stop.
pub fn judge(job: &Job, context: &RunContext, monitor: &dyn Monitor) -> Result<Judged, StepError> {
    let study = job.study();
    let paths = job.layout();
    let manifest = finished_sweep(job, context)?;
    if let Some(reason) = &manifest.left_out {
        bail!("there is nothing to judge: {reason}");
    }
    let store = unit_store(&paths.sweep(), manifest.arithmetic.as_deref());
    let results = store.collect(&manifest.units, &manifest.settings).map_err(|reason| {
        StepError::Missing(format!(
            "the sweep is not complete; run `{}` again: {}",
            manifest.again(&job.command(StepKind::Sweep)),
            StepError::from(reason)
        ))
    })?;
    let sensors = study.sweep.sensors.iter();
    let profile = learned::profile(job)?;
    let clock = ShownClock::of(&study.data, profile.utc);
    let doubts = profile.value_doubts(&clock);
    let mut verdicts = sensors
        .map(|sensor| {
            monitor.check()?;
            let mut verdict = verdict_of(sensor, study.part(), study, &manifest, &results)?;
            let reads_inputs = verdict_rows::frozen(&verdict, &manifest)
                .is_none_or(|predictor| !predictor.reads_the_sensor_alone());
            if reads_inputs && profile.has_inputs_elsewhere(sensor) {
                verdict.doubt_inputs();
            }
            let of_it = doubts.iter().filter(|(name, _)| name == sensor);
            verdict.warnings.extend(of_it.map(|(_, doubt)| doubt.clone()));
            let recorded = profile.recorded_name(sensor);
            let mut sentinels = profile.sentinels.iter().flat_map(|sentinel| &sentinel.channels);
            if sentinels.any(|channel| channel == recorded) {
                verdict.warnings.extend(profile.sentinel_doubt());
            }
            Ok(verdict)
        })
        .collect::<Result<Vec<_>, StepError>>()
        .with_context(|| {
            format!(
                "{} cannot be judged; if they were edited, `{} --force` makes them again",
                paths.sweep().display(),
                manifest.again(&job.command(StepKind::Sweep))
            )
        })?;
    let periods = recorded::Periods {
        beside_pretraining: if study.has_model() { "model" } else { "log replay" },
        held_out: job.deployment().unwrap_or("held out"),
        clock: &clock,
    };
    let kept = recorded::figures(&paths.sweep(), &study.sweep.sensors, periods)?;
    for (verdict, kept) in verdicts.iter_mut().zip(&kept) {
        verdict.warnings.extend(changed_level(verdict, kept));
    }
    let rows: Vec<calib_report::Verdict> = verdicts
        .iter()
        .zip(&kept)
        .map(|(verdict, kept)| {
            let outside = kept.outside_training();
            verdict_row(verdict, outside, &manifest, study, job.model_name())
        })
        .collect();
    let summary = Summary {
        predicts: Some(predicts(study, profile.sampled_period_secs)),
        notes: [
            profile.unit_doubts(&study.sweep.sensors, &clock),
            profile.held_out_doubts(&study.sweep.sensors),
            manifest.notes.clone(),
            stale_rollouts(job, manifest.model.as_deref())?,
        ]
        .concat(),
        ..Summary::new(job.title(), verdicts, &rows, &manifest.candidates)
    };
    Ok(Judged { job: job.clone(), manifest, results, summary, recorded: kept, rows, clock })
}

/// That a sensor has another level than in training, with both medians in its unit; or, if the medians are alike, that its
/// values are far more spread.
fn changed_level(verdict: &SensorVerdict, recorded: &RecordedFigure) -> Option<String> {
    let [learned, held_out] = recorded.levels().filter(|_| verdict.level_may_have_changed())?;
    if !held_out.is_apart_from(&learned) {
        return held_out.is_far_more_spread_than(&learned).then(|| {
            "held-out values are far more spread than training values, around about the same median, so a few excursions may decide the errors; \
             look at what happened then, in the figure of recorded values"
                .to_owned()
        });
    }
    let unit =
        if verdict.elsewhere().is_some() { ", or the unit or the zero of the sensor" } else { "" };
    let [before, now] = numbers_apart([learned.median, held_out.median]);
    Some(format!(
        "half of the values lie above {before} in the training range and above {now} in the held-out period, so the plant has changed{unit}, and what was learned before may not hold; \
         train on a time that is like the present (data.train)"
    ))
}

/// Returns one sentence per discount factor on what the agents predict. `state_secs` is the time between states.
fn predicts(study: &Study, state_secs: f64) -> String {
    let gammas = study.gammas();
    let sentences = gammas.iter().map(|&gamma| {
        let sensors: Vec<&str> = study.sensors_of(gamma).map(String::as_str).collect();
        let agents = match sensors.split_last() {
            Some((last, [])) if gammas.len() > 1 => format!("Agents for {last}"),
            Some((last, others)) if gammas.len() > 1 => {
                format!("Agents for {} and {last}", others.join(", "))
            }
            _ => "Agents".to_owned(),
        };
        predicted_by(&agents, gamma, state_secs)
    });
    sentences.collect::<Vec<String>>().join(" ")
}

/// Returns a sentence on what these agents predict with this discount factor. `state_secs` is the time between states.
fn predicted_by(agents: &str, gamma: f64, state_secs: f64) -> String {
    let state = span(state_secs);
    if gamma == 0.0 {
        return format!("{agents} predict the next value of their sensor, {state} ahead.");
    }
    let horizon = span(state_secs / (1.0 - gamma));
    format!(
        "{agents} predict the mean of their sensor over about the next {horizon} (gamma = {gamma}, one state every {state})."
    )
}

/// Returns the verdict of a finished sweep on a sensor, by the errors over `part` of each run.
///
/// # Errors
/// Returns an error if the results lack runs that the rule needs.
pub fn verdict_of(
    sensor: &str,
    part: Part,
    study: &Study,
    manifest: &SweepFacts,
    results: &[UnitResult],
) -> Result<SensorVerdict, SweepError> {
    let judging = judging(study, part, manifest, sensor);
    let mut verdict = verdict(sensor, &manifest.candidates, results, &judging)?;
    if study.has_model() && study.sweep_starts().start == StartKind::Nearest {
        verdict.warnings.insert(0, LOOKED_AHEAD.to_owned());
    }
    Ok(verdict)
}

/// Returns how a sensor is judged.
pub(crate) fn judging<'a>(
    study: &Study,
    part: Part,
    sweep: &'a SweepFacts,
    sensor: &str,
) -> Judging<'a> {
    Judging {
        part,
        rule: study.evaluate.rule,
        top_k: study.evaluate.top_k,
        scales: &sweep.scales,
        simple: &sweep.simple.scores,
        best: sweep.simple.best.get(sensor).copied(),
        stands_still: sweep.standing_still.iter().any(|still| still == sensor),
        resamples: study.evaluate.resamples,
        seed: Seed::new(study.seed).child("verdict"),
    }
}

/// The warning about a choice from rollouts that start at the nearest states to those of the deployment.
const LOOKED_AHEAD: &str = "the sweep's rollouts start at the recorded states that are nearest to those of the deployment: this \
     choice has looked into what it is judged on, as no choice can that is made before; sweep.start = \"recent\" is what is \
     known beforehand";

/// Whether a sweep was finished with the current study.
pub fn is_swept(job: &Job, context: &RunContext) -> bool {
    finished_sweep(job, context).is_ok()
}

/// Returns a note if rollouts of another study are left out of the report. They do not prevent the verdict.
fn stale_rollouts(job: &Job, model: Option<&str>) -> Result<Vec<String>, StepError> {
    let Some(model) = model else { return Ok(Vec::new()) };
    let directory = job.layout().rollout();
    let finished = rollout::finished(job, Some(model))?;
    let stale = if finished.is_none() && directory.join(MANIFEST).exists() {
        "rollouts"
    } else if finished.is_some() && one_step::is_stale(job, model) {
        "one-step errors"
    } else {
        return Ok(Vec::new());
    };
    Ok(vec![format!(
        "the {stale} in {} were made with other settings, or are damaged, and are not shown; run `{}` again",
        directory.display(),
        job.command(StepKind::Rollout)
    )])
}

/// Returns the manifest of a sweep that was made with the current study and model.
fn finished_sweep(job: &Job, context: &RunContext) -> Result<SweepManifest, StepError> {
    let directory = &job.layout().sweep();
    let again = job.command(StepKind::Sweep);
    let mut manifest: SweepManifest = artefact::require(directory, &again)?;
    StoredArtefact { step: StepKind::Sweep, study: &manifest.study, directory }.check(job)?;
    check_log(job, &manifest, context)?;
    let model = model_files::content_of(job)?;
    if model.is_some() && model != manifest.model {
        let reason = format!("the model was built again after the sweep; run `{again}` again");
        return Err(StepError::Stale(reason));
    }
    artefact::check_files(directory, &manifest.files, &again)?;
    if manifest.left_out.is_none() {
        manifest.simple = SimpleErrors::read(directory)?;
    }
    Ok(manifest)
}

/// Checks that a log that may have changed since the sweep still has the same states.
fn check_log(job: &Job, swept: &SweepFacts, context: &RunContext) -> Result<(), StepError> {
    if job.reads_the_log_of(&swept.study) {
        return Ok(());
    }
    let dataset = partition::load(job, &context.silent())?.dataset;
    let held_out = swept.held_out.as_ref().and_then(|states| states.data.as_ref());
    if dataset.fingerprint == swept.data && dataset.held_out_fingerprint.as_ref() == held_out {
        return Ok(());
    }
    Err(StepError::Stale(format!(
        "the sweep in {} is of other data than those in {}; run `{}` again",
        job.layout().sweep().display(),
        job.study().data.path.0.join(", "),
        job.command(StepKind::Sweep)
    )))
}
