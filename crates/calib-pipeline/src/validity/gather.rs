//! Collects the results of a study for each of its sensors.

use calib_agent::Part;
use calib_base::{StepError, bail, log::context::RunContext};
use calib_core::Silent;
use calib_model::ModelFamily;
use calib_model_steps::rollouts::{
    one_step::{self, OneStep},
    rollout::{self, RolloutManifest},
};
use calib_sweep::{BaselineRegret, Candidate, ChoiceBaseline, SensorVerdict, SweepError, Truth};
use calib_sweep_steps::verdict::{evaluate, judged::Judged};
use calib_validity::{ModelPair, Pair, RuleChoice};

use super::{race, studies::ListedStudy, task::Task};

/// With fewer scored horizons after the first quarter, the error depends more on the scored stretch than on the
/// setting.
const HORIZONS: f64 = 200.0;

/// The sensors and swept settings of a study.
pub(super) struct Gathered {
    /// Label of each setting of the grid.
    pub(super) values: Vec<String>,
    pub(super) task: Task,
    /// The scored part of a run, and a pair by that score.
    pub(super) pairs: Vec<(Part, Pair)>,
    /// Models that are networks.
    pub(super) networks: Vec<String>,
    /// Models without a choice, as "model, sensor".
    pub(super) without: Vec<String>,
}

/// One model of a study, with all evidence about it.
struct ModelEvidence {
    name: String,
    judged: Judged,
    rollouts: Option<RolloutManifest>,
    one_step: Option<OneStep>,
}

/// The reason why a study is not judged.
pub(super) struct ReasonLeftOut(pub(super) String);

/// Collects all sensors of `study` in all its deployments, with the choices of `models`, or returns why it is not
/// judged. There are two scores: the study's own, and the last three quarters of runs that are long enough.
pub(super) fn gather(
    study: &ListedStudy,
    models: &[Option<String>],
    least_windows: usize,
    context: &RunContext,
) -> Result<Result<Gathered, ReasonLeftOut>, StepError> {
    let mut gathered: Option<Gathered> = None;
    let mut reasons = Vec::new();
    for deployment in &study.deployments {
        let deployment = deployment.as_deref();
        if deployment.is_some()
            && let Some(first) = models.first()
            && let Some(reason) =
                evaluate::left_out(&study.job.choose(first.as_deref(), deployment)?, context)?
        {
            reasons.push(reason);
            continue;
        }
        let mut all = Vec::with_capacity(models.len());
        for model in models {
            all.push(of_model(study, model.as_deref(), deployment, context)?);
        }
        let Some(first) = all.first() else {
            return Ok(Err(ReasonLeftOut("no model of it can be made here".to_owned())));
        };
        let windows = first.judged.manifest.windows.len();
        if windows < least_windows {
            reasons.push(format!(
                "{windows} held-out window fits, and the protocol wants {least_windows}"
            ));
            continue;
        }
        let own = gathered.get_or_insert_with(|| Gathered {
            values: first.judged.manifest.candidates.iter().map(Candidate::label).collect(),
            task: Task::of(first.judged.study(), first.judged.manifest.span.steps),
            pairs: Vec::new(),
            networks: networks(&all),
            without: Vec::new(),
        });
        for sensor in &first.judged.study().sweep.sensors {
            add(own, sensor, deployment, study, &all)?;
        }
    }
    Ok(gathered.ok_or_else(|| ReasonLeftOut(reasons.join("; "))))
}

fn of_model(
    study: &ListedStudy,
    model: Option<&str>,
    deployment: Option<&str>,
    context: &RunContext,
) -> Result<ModelEvidence, StepError> {
    let judged = evaluate::judge(&study.job.choose(model, deployment)?, context, &Silent)?;
    let name = judged.job.model_name().to_owned();
    let rollouts = rollout::finished(&judged.job, judged.manifest.model.as_deref())?;
    let one_step = rollouts.as_ref().and_then(|made| one_step::read(&judged.job, &made.model));
    Ok(ModelEvidence { name, judged, rollouts, one_step })
}

fn networks(models: &[ModelEvidence]) -> Vec<String> {
    let networks = models
        .iter()
        .filter(|model| model.judged.study().model.kind.family() == ModelFamily::Network);
    networks.map(|model| model.name.clone()).collect()
}

/// Adds a sensor by each score.
fn add(
    gathered: &mut Gathered,
    sensor: &str,
    deployment: Option<&str>,
    study: &ListedStudy,
    models: &[ModelEvidence],
) -> Result<(), StepError> {
    let own = models[0].judged.study().part();
    let parts = [own, Part::AfterFirstQuarter];
    for part in if own == parts[1] { &parts[..1] } else { &parts } {
        let verdicts = models.iter().map(|model| verdict(model, sensor, *part));
        // A run without a step in this part cannot be judged by it.
        let Some(verdicts) = verdicts.collect::<Result<Option<Vec<_>>, StepError>>()? else {
            continue;
        };
        let Some(truth) = verdicts.first().and_then(|first| first.truth.as_ref()) else {
            bail!(
                "{} has no held-out data, so calib cannot judge how well it chooses there; set data.held_out, or leave the study out",
                study.path().display()
            );
        };
        if *part != own && truth.horizons < HORIZONS {
            continue;
        }
        let candidates = &models[0].judged.manifest.candidates;
        let mut pair = pair(study, sensor, truth, candidates, &gathered.task);
        for (model, verdict) in models.iter().zip(&verdicts) {
            let errors = verdict.selection.iter().flat_map(|ranks| &ranks.mean_errors);
            if errors.clone().all(|error| error.is_infinite()) {
                if *part == own {
                    gathered.without.push(format!("{}, {sensor}", model.name));
                }
                continue;
            }
            pair.models.push(model_pair(model, verdict)?);
        }
        if let Some(deployment) = deployment {
            pair.sensor = format!("{sensor} ({deployment})");
        }
        gathered.pairs.push((*part, pair));
    }
    Ok(())
}

/// Returns the verdict of a model's sweep on a sensor by the errors over `part`. `None` if some run has no step there.
fn verdict(
    model: &ModelEvidence,
    sensor: &str,
    part: Part,
) -> Result<Option<SensorVerdict>, StepError> {
    let Judged { job, manifest, results, summary, .. } = &model.judged;
    let study = job.study();
    if part == study.part() {
        return Ok(summary
            .verdicts
            .iter()
            .find(|verdict_of_sensor| verdict_of_sensor.sensor == sensor)
            .cloned());
    }
    match evaluate::verdict_of(sensor, part, study, manifest, results) {
        Err(SweepError::NothingScored { .. }) => Ok(None),
        verdict => Ok(Some(verdict?)),
    }
}

fn pair(
    study: &ListedStudy,
    sensor: &str,
    truth: &Truth,
    candidates: &[Candidate],
    task: &Task,
) -> Pair {
    Pair {
        plant: study.plant.clone(),
        sensor: sensor.to_owned(),
        optimiser: task.optimiser.to_owned(),
        task: task.features(),
        online: truth.scores.candidates[..candidates.len()]
            .iter()
            .map(|candidate| candidate.mean)
            .collect(),
        skill: truth.best.and_then(|best| truth.scores.skill[best]),
        regrets: truth.regrets.clone(),
        default: chosen_by(truth, ChoiceBaseline::Default),
        log_replay: chosen_by(truth, ChoiceBaseline::LogReplay),
        latest_window: chosen_by(truth, ChoiceBaseline::LatestWindow),
        another_window: baseline(truth, ChoiceBaseline::AnotherWindow)
            .and_then(|found| found.regret)
            .map(|regret| regret.value),
        models: Vec::new(),
    }
}

fn baseline(truth: &Truth, wanted: ChoiceBaseline) -> Option<&BaselineRegret> {
    truth.baselines.iter().find(|found| found.baseline == wanted)
}

/// Returns the setting that another way to choose has chosen, if it chooses one.
fn chosen_by(truth: &Truth, wanted: ChoiceBaseline) -> Option<usize> {
    baseline(truth, wanted).and_then(|found| found.chosen)
}

fn model_pair(model: &ModelEvidence, verdict: &SensorVerdict) -> Result<ModelPair, StepError> {
    let one_step = model.one_step.as_ref();
    let of_sensor = one_step
        .and_then(|errors| errors.sensors.iter().find(|sensor| sensor.sensor == verdict.sensor));
    let comparison = model.rollouts.as_ref().and_then(|rollouts| rollouts.comparison.as_ref());
    let compared = comparison.and_then(|comparison| {
        comparison.sensors.iter().find(|sensor| sensor.sensor == verdict.sensor)
    });
    let dtw = compared.and_then(|sensor| sensor.dtw.first()).map(|distances| {
        let distance = distances.normalized_distance.as_ref().unwrap_or(&distances.distance);
        distance.mean
    });
    let share = verdict.stability.iter().find(|share| share.candidate == verdict.chosen);
    let halved = race::outcome(&model.judged, verdict)?;
    let rules = verdict
        .rules
        .iter()
        .map(|choice| RuleChoice { rule: choice.rule.name().to_owned(), chosen: choice.chosen })
        .chain([RuleChoice { rule: "halved".to_owned(), chosen: halved.chosen }]);
    Ok(ModelPair {
        model: model.name.clone(),
        chosen: verdict.chosen,
        stability: match share {
            Some(share) => Some(share.share),
            None if verdict.stability.is_empty() => None,
            None => Some(0.0),
        },
        rules: rules.collect(),
        saved_by_halving: Some(halved.saved),
        spearman: verdict.truth.as_ref().and_then(|truth| truth.choice.spearman),
        one_step: of_sensor.and_then(|sensor| sensor.error.rmse),
        one_step_relative: of_sensor.and_then(|sensor| sensor.error.relative),
        one_step_all: one_step.and_then(|errors| errors.all_columns.rmse),
        dtw,
    })
}
