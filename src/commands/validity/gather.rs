//! What a study says about its sensors.

use anyhow::bail;
use calib_sweep::{Baseline, Candidate, EnvironmentScores, SensorVerdict};
use calib_validity::{ModelPair, Pair};

use super::{
    super::{
        evaluate::{self, Judged},
        one_step::{self, OneStep},
        rollout::{self, RolloutManifest},
    },
    studies::{Listed, args_of},
};
use crate::{cli::ValidityArgs, output::Printer};

/// A study's sensors, and the values that were swept.
pub(super) struct Gathered {
    /// Label of each value of the grid.
    pub(super) values: Vec<String>,
    pub(super) pairs: Vec<Pair>,
}

/// One model of a study with what is known of it.
struct OfModel {
    name: String,
    judged: Judged,
    rollouts: Option<RolloutManifest>,
    one_step: Option<OneStep>,
}

/// All sensors of `study` in all its deployments, with what each of `models` chose.
pub(super) fn gather(
    study: &Listed,
    models: &[Option<String>],
    args: &ValidityArgs,
    printer: &Printer,
) -> anyhow::Result<Gathered> {
    let mut gathered = Gathered { values: Vec::new(), pairs: Vec::new() };
    for deployment in &study.deployments {
        let deployment = deployment.as_deref();
        let of = models.iter().map(|model| of_model(study, (model.as_deref(), deployment), args));
        let of = of.collect::<anyhow::Result<Vec<_>>>()?;
        let Some(first) = of.first() else {
            bail!("{}: no model of it can be made here", study.path.display());
        };
        let candidates = &first.judged.manifest.candidates;
        gathered.values = candidates.iter().map(Candidate::label).collect();
        for verdict in &first.judged.summary.verdicts {
            let mut own = pair(study, verdict, candidates, &of, printer)?;
            if let Some(deployment) = deployment {
                own.sensor = format!("{} ({deployment})", own.sensor);
            }
            gathered.pairs.push(own);
        }
    }
    Ok(gathered)
}

fn of_model(
    study: &Listed,
    (model, deployment): (Option<&str>, Option<&str>),
    args: &ValidityArgs,
) -> anyhow::Result<OfModel> {
    let judged = evaluate::judge(&args_of(study, (model, deployment), args))?;
    let key = &judged.manifest.model;
    let rollouts = rollout::finished(&judged.study, &judged.paths, key);
    let one_step =
        rollouts.as_ref().and_then(|_| one_step::read(&judged.study, &judged.paths, key));
    let name = model.unwrap_or_else(|| judged.study.model_name()).to_owned();
    Ok(OfModel { name, judged, rollouts, one_step })
}

fn pair(
    study: &Listed,
    verdict: &SensorVerdict,
    candidates: &[Candidate],
    models: &[OfModel],
    printer: &Printer,
) -> anyhow::Result<Pair> {
    let Some(online) = verdict.truth.as_ref().map(|truth| &truth.scores) else {
        bail!(
            "{} has no held-out data, so nobody can say how well calib chooses there; set data.held_out, or leave it out",
            study.path.display()
        );
    };
    let values = candidates.len();
    let mut of_models = Vec::with_capacity(models.len());
    for model in models {
        match model_pair(model, &verdict.sensor) {
            Some(pair) if pair.selection.mean_errors[pair.selection.chosen].is_finite() => {
                of_models.push(pair);
            }
            Some(_) => printer.warn(&format!(
                "{} of {} has no choice for {}: every value diverged in a member",
                model.name, study.plant, verdict.sensor
            )),
            None => {}
        }
    }
    let default = candidates.iter().find(|candidate| candidate.is_default);
    let log_replay = verdict.truth.iter().flat_map(|truth| &truth.baselines);
    let log_replay =
        log_replay.filter(|of| of.baseline == Baseline::LogReplay).find_map(|of| of.chosen);
    Ok(Pair {
        plant: study.plant.clone(),
        sensor: verdict.sensor.clone(),
        online: means(online)[..values].to_vec(),
        default: default.map(|default| default.index).filter(|&index| index < values),
        log_replay,
        models: of_models,
    })
}

fn means(scores: &EnvironmentScores) -> Vec<f64> {
    scores.candidates.iter().map(|summary| summary.mean).collect()
}

fn model_pair(model: &OfModel, sensor: &str) -> Option<ModelPair> {
    let verdicts = &model.judged.summary.verdicts;
    let verdict = verdicts.iter().find(|verdict| verdict.sensor == *sensor)?;
    let one_step = model.one_step.as_ref();
    let of_sensor = one_step.and_then(|of| of.sensors.iter().find(|of| of.sensor == *sensor));
    let comparison = model.rollouts.as_ref().and_then(|rollouts| rollouts.comparison.as_ref());
    let compared = comparison.and_then(|of| of.sensors.iter().find(|of| of.sensor == *sensor));
    let dtw = compared.and_then(|of| of.dtw.first()).map(|of| {
        let distance = of.normalized_distance.as_ref().unwrap_or(&of.distance);
        distance.mean
    });
    Some(ModelPair {
        model: model.name.clone(),
        selection: verdict.selection.clone(),
        spearman: verdict.truth.as_ref().and_then(|truth| truth.choice.spearman),
        one_step: of_sensor.and_then(|of| of.error.rmse),
        one_step_relative: of_sensor.and_then(|of| of.error.relative),
        one_step_all: one_step.and_then(|of| of.all_columns.rmse),
        dtw,
    })
}
