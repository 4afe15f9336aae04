//! The training of the agents of several sensors on the part of the log for pre-training.

use calib_agent::{
    AgentConfig, FittedPredictor, Fitter, Learner, Pretraining, PretrainingDiverged, StateFile,
    pretrain, with_traces,
};
use calib_base::{Context as _, StepError, log::partition::Parts};
use calib_core::{Monitor, RowStream, Seed};
use calib_study::Study;

use crate::agents::pretrain_files::TrainedAgent;

/// An agent to pre-train for a sensor, and its key.
pub(super) struct AgentToTrain {
    pub(super) sensor: String,
    pub(super) column: usize,
    pub(super) key: String,
}

/// Pre-trains the `missing` agents. With a `file`, an interrupted training resumes.
pub(super) fn train(
    study: &Study,
    parts: &Parts,
    missing: &[&AgentToTrain],
    file: Option<&StateFile>,
    monitor: &dyn Monitor,
) -> Result<Vec<Result<TrainedAgent, PretrainingDiverged>>, StepError> {
    if missing.is_empty() {
        return Ok(Vec::new());
    }
    let frames = &parts.pretrain.as_ref().context("agents are pre-trained")?.frames;
    let stream = RowStream::replay(frames.states().clone(), frames.segments());
    let configs: Vec<AgentConfig> = missing
        .iter()
        .map(|wanted| study.pretrain.agent(&study.agent.for_sensor(&wanted.sensor)))
        .collect();
    let seen = with_traces(&stream, &study.agent.traces);
    // The baselines must not be fitted on the validation rows either.
    let validated = (frames.rows() as f64 * study.pretrain.validation_fraction).round() as usize;
    let validated = frames.rows() - validated.max(1)..frames.rows();
    let excluded = std::slice::from_ref(&validated);
    let gammas = study.gammas().into_iter();
    let fitters: Vec<(f64, Fitter<'_>)> =
        gammas.map(|gamma| (gamma, Fitter::new(&*seen, gamma, excluded))).collect();
    let fitted: Vec<Option<FittedPredictor>> = missing
        .iter()
        .zip(&configs)
        .map(|(wanted, config)| {
            let (_, fitter) = fitters.iter().find(|(gamma, _)| *gamma == config.gamma)?;
            Some(fitter.fit(config.baseline?, wanted.column))
        })
        .collect();
    let baselines: Vec<Option<Vec<f32>>> =
        fitted.iter().map(|fitted| Some(fitted.as_ref()?.predictions(&*seen))).collect();
    let learners: Vec<Learner<'_>> = missing
        .iter()
        .zip(&configs)
        .zip(&baselines)
        .map(|((wanted, config), baseline)| Learner {
            config,
            cumulant: wanted.column,
            start: None,
            baseline: baseline.as_deref(),
        })
        .collect();
    let training = Pretraining {
        stream: &stream,
        settings: study.pretrain.settings(),
        seed: Seed::new(study.seed).child("pretrain"),
    };
    let trained = pretrain(training, &learners, file, monitor);
    let trained = trained.context("pre-training")?.into_iter().zip(fitted);
    Ok(trained
        .map(|(pretrained, baseline)| Ok(TrainedAgent { pretrained: pretrained?, baseline }))
        .collect())
}
